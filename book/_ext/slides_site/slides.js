/* The slides of a chapter: reveal.js, and laboratories as large as there is room for. */
(function () {
  "use strict";
  const root = document.documentElement, PRINT = /print-pdf/i.test(location.search);
  const ENTRY = "input, select, summary, .pfslam-plan", VIRTUAL = 560; // so many pixels high a laboratory takes the slide for
  const BESIDE = 275, BELOW = 80; // pixels for what turns it
  const ratio = devicePixelRatio;

  /* The theme of the book's other pages, where they could keep one, or that of the machine. On paper it is the light one. */
  function theme() {
    let kept = null;
    try {
      kept = localStorage.getItem("mode");
    } catch { /* nothing is kept here */ }
    const dark = kept === "dark" || (kept !== "light" && matchMedia("(prefers-color-scheme: dark)").matches);
    return dark && !PRINT ? "dark" : "light";
  }

  /* What turns a laboratory's pictures comes into a box of its own, beside them or below. */
  function arrange(figure) {
    const side = document.createElement("div");
    side.className = "pfslam-side";
    side.append(...figure.querySelectorAll(".pfslam-lab-body > :not(canvas, .pfslam-plan)"));
    [...side.querySelectorAll("button")].find(button => button.textContent === "Link")?.remove();
    figure.append(side);
    return side;
  }

  /* The width at which all pictures are seen at once, and the share of the slide that they then cover. */
  function sized(sheets, wide, high) {
    const tall = width => sheets.reduce((sum, sheet) => sum + sheet.aspect(width) + 8, -8);
    let width = wide;
    while (width > 100 && tall(width) > high) width *= 0.98;
    return {width, area: width * tall(width)};
  }

  /* A laboratory fills its place, in letters as large as those of a slide, unless it can be much larger in smaller ones. */
  function fit(box) {
    const figure = box.querySelector(".pfslam-lab"), stage = figure.lab?.stage;
    if (!stage || !box.clientWidth) return;
    const side = figure.querySelector(".pfslam-side") || arrange(figure);
    const pictures = stage.sheets.filter(sheet => !side.contains(sheet.canvas));
    const few = side.querySelectorAll(".pfslam-slider, .pfslam-legend").length <= 2 && !side.querySelector("fieldset");
    let best = {worth: 0};
    for (const share of [1, 0.9, 0.8, 0.7, 0.6]) {
      for (const below of few ? [false, true] : [false]) {
        const scale = (share * innerHeight) / VIRTUAL, wide = box.clientWidth / scale, high = box.clientHeight / scale;
        const {width, area} = sized(pictures, wide - (below ? 0 : BESIDE), high - (below ? BELOW : 0));
        const worth = area * scale ** 2 * share ** 0.5;
        if (worth > best.worth) best = {worth, scale, wide, high, width, below};
      }
    }
    figure.classList.toggle("pfslam-below", best.below);
    figure.style.cssText = `width: ${best.wide}px; height: ${best.high}px; transform: scale(${best.scale})`;
    for (const sheet of stage.sheets) sheet.widest = () => (pictures.includes(sheet) ? best.width : BESIDE - 20);
    stage.fitted = 0;
    stage.fit();
  }

  const fitAll = place => place.querySelectorAll(".shown-lab").forEach(fit);

  /* Who has touched a laboratory drives it by keys, until Escape; a presenter's remote turns pages even then. */
  function leave(event) {
    const inside = document.activeElement.closest(".pfslam-lab");
    if (!["PageDown", "PageUp"].includes(event.key) && !(event.key === "Escape" && inside)) return;
    event.preventDefault();
    event.stopPropagation();
    document.activeElement.blur();
    if (event.key === "PageDown") Reveal.next();
    if (event.key === "PageUp") Reveal.prev();
  }

  function isOurs(event) {
    const at = document.activeElement;
    return !event.defaultPrevented && !at.matches(ENTRY) && !(at.matches("button") && [" ", "Enter"].includes(event.key));
  }

  root.dataset.theme = theme();
  for (const picture of document.querySelectorAll("img[loading]")) picture.loading = "eager";
  if (innerWidth < 600 && !PRINT && self === top) { // on a phone one reads: the slides stand under one another
    root.classList.add("pfslam-plain");
    document.querySelector(".reveal").classList.remove("reveal");
    return;
  }
  Object.defineProperty(window, "devicePixelRatio", {get: () => ratio * innerHeight / VIRTUAL}); // sharp when enlarged
  addEventListener("keydown", leave, true);
  Reveal.initialize({
    width: "100%", height: "100%", margin: 0, minScale: 1, maxScale: 1, center: false, transition: "none",
    backgroundTransition: "none", hash: true, slideNumber: "c/t", pdfSeparateFragments: false, controls: false,
    scrollActivationWidth: 0, keyboardCondition: isOurs, plugins: [RevealNotes],
  }).then(() => {
    Reveal.addKeyBinding({keyCode: 80, key: "P", description: "Print view"}, () => window.open("?print-pdf"));
    Reveal.addKeyBinding({keyCode: 68, key: "D", description: "Dark or light"}, () => {
      root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    });
    const arrive = () => fitAll(PRINT ? document : Reveal.getCurrentSlide());
    Reveal.on("slidechanged", () => document.activeElement.blur());
    for (const kind of ["slidechanged", "resize", "pdf-ready"]) Reveal.on(kind, arrive);
    arrive();
  });
})();
