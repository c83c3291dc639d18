/* In the dark theme each figure is the one on dark paper, in the same colours; on paper it is the light one again. */
(function () {
  "use strict";
  const root = document.documentElement;
  const figures = Array.from(document.querySelectorAll('img[data-night]:not([data-night=""])'));
  let printing = false;

  function choose() {
    const dark = root.dataset.theme === "dark" && !printing;
    for (const image of figures) {
      image.dataset.day ??= image.src;
      image.loading = dark ? "lazy" : "eager"; // only a dark figure is a file, asked for when it comes into view
      const wanted = dark ? image.dataset.night : image.dataset.day;
      if (image.getAttribute("src") !== wanted) image.src = wanted;
    }
  }

  choose();
  new MutationObserver(choose).observe(root, {attributes: true, attributeFilter: ["data-theme"]});
  window.addEventListener("beforeprint", () => { printing = true; choose(); });
  window.addEventListener("afterprint", () => { printing = false; choose(); });
})();
