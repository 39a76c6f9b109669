// Language and look, before anything is painted: the style sheet knows its looks by name only.
"use strict";

(() => {
  const root = document.documentElement;
  const { language, look } = document.currentScript.dataset;
  root.lang = language;
  root.classList.add("unready");
  if (look) {
    root.dataset.theme = look;
    return;
  }
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const follow = () => {
    root.dataset.theme = dark.matches ? "dark" : "light";
  };
  follow();
  dark.addEventListener("change", follow);
})();
