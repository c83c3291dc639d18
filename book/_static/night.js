/* In the dark theme each figure is the one on dark paper, in the same colours. On paper the whole page is light again. */
(function () {
  "use strict";
  const root = document.documentElement;
  const figures = Array.from(document.querySelectorAll('[data-night]:not([data-night=""])')); // and those for phones
  let theme = null; // while the page is printed, the one before

  function choose() {
    const dark = root.dataset.theme === "dark";
    for (const image of figures) {
      const address = image.matches("source") ? "srcset" : "src";
      image.dataset.day ??= image[address];
      const wanted = dark ? image.dataset.night : image.dataset.day;
      if (image.getAttribute(address) !== wanted) image[address] = wanted;
    }
  }

  choose();
  new MutationObserver(choose).observe(root, {attributes: true, attributeFilter: ["data-theme"]});
  function print(on) {
    if (on) theme = root.dataset.theme;
    root.dataset.theme = on ? "light" : theme;
    choose();
  }
  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", () => print(false));
})();
