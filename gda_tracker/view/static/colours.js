// Colours of the theme, and of classes.

const CERTAIN = 0.6; // a track has the colour of a class from here on

let cache = null;

export function colours() {
  if (cache) return cache;
  const style = getComputedStyle(document.documentElement);
  cache = new Proxy({}, {
    get: (known, name) => (known[name] ??= style.getPropertyValue(`--${name}`).trim()),
  });
  return cache;
}

export function switchTheme() {
  const root = document.documentElement;
  root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
  localStorage.setItem("gda-tracker-theme", root.dataset.theme);
  cache = null;
}

export const classColour = (index) => colours()[`class-${Math.min(index, 3)}`];

// The class of one row of probabilities, -1 where none is certain enough.
export function classOf(probability) {
  let best = -1;
  for (let i = 0; i < probability.length; i++) {
    if (probability[i] >= CERTAIN && (best < 0 || probability[i] > probability[best])) best = i;
  }
  return best;
}

export function trackColour(probability) {
  const index = classOf(probability ?? []);
  return index < 0 ? colours().unknown : classColour(index);
}

export function withAlpha(hex, alpha) {
  const [r, g, b] = [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
  return `rgba(${r},${g},${b},${alpha})`;
}
