// Light or dark: as the system says until somebody says otherwise. Runs before the page is drawn.
(() => {
  const told = localStorage.getItem("gda-tracker-theme");
  const dark = told ? told === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = dark ? "dark" : "light";
})();
