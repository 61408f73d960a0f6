// The keyboard.

const typing = (target) => target.closest("input[type=text], input[type=search], select, textarea, dialog");

export function listenToKeys(actions) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || typing(event.target)) return;
    // A focused button or slider keeps its own keys.
    if (event.key === " " && event.target.closest("button, input")) return;
    if (event.key.startsWith("Arrow") && event.target.closest("input[type=range]")) return;
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
}
