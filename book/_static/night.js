/* In the dark theme each figure is the one on dark paper, in the same colours. On paper the whole page is light again. */
(function () {
  "use strict";
  const root = document.documentElement;
  const figures = Array.from(document.querySelectorAll('[data-night]:not([data-night=""])')); // and those for phones
  const days = new Map(); // of each figure that is seen in the dark, the one on white paper, which a printer waits for no more
  let theme = null; // while the page is printed, the one before

  const absolute = address => new URL(address, document.baseURI).href;

  /* A picture that the page has takes the other's place at once. On a phone the dark one may be that of a source. */
  function keepDay(image) {
    const those = [image, ...image.parentElement.querySelectorAll("source")];
    const shown = those.find(({dataset}) => dataset.night && absolute(dataset.night) === image.currentSrc);
    if (shown) days.set(image, Object.assign(new Image(), {src: shown.dataset.day}));
  }

  function choose() {
    const dark = root.dataset.theme === "dark";
    for (const image of figures) {
      const address = image.matches("source") ? "srcset" : "src";
      image.dataset.day ??= image[address];
      const wanted = dark ? image.dataset.night : image.dataset.day;
      if (image.getAttribute(address) !== wanted) image[address] = wanted;
      if (theme && address === "src") image.loading = "eager";
    }
  }

  for (const image of figures) image.addEventListener("load", () => keepDay(image));
  choose();
  // The picture of an explorer may have come before this script.
  for (const image of figures) if (image.complete && image.naturalWidth) keepDay(image);
  new MutationObserver(choose).observe(root, {attributes: true, attributeFilter: ["data-theme"]});
  function print(on) {
    if (on) theme = root.dataset.theme;
    root.dataset.theme = on ? "light" : theme;
    if (!on) theme = null;
    choose();
  }
  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", () => print(false));
})();
