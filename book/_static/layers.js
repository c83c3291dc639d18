/* Words and picture are one: a word that names a thing, in the text or below the picture, lights it in the laboratory and lights all words for it.
 * A pointer or the focus lights it while it is there; a press, by mouse, finger or key, until the next one or Escape.
 * A pointer on the picture lights the words for what it points at. */
(function () {
  "use strict";
  let held = null, shown = {}; // the word that was pressed; what is lit now

  /* The laboratory that a word speaks of: its own, that beside it, the next of its section, or the last before it. */
  function labOf(word) {
    const near = word.closest(".pfslam-lab, .pfslam-beside, section"), labs = near ? [...near.querySelectorAll(".pfslam-lab")] : [];
    if (near?.matches(".pfslam-lab")) return near;
    return labs.find(lab => word.compareDocumentPosition(lab) & Node.DOCUMENT_POSITION_FOLLOWING) ?? labs.at(-1);
  }

  /* Light a layer of a laboratory: its words, and the picture as well unless the pointer is on it. */
  function light(lab, layer, inPicture = true) {
    if (lab === shown.lab && layer === shown.layer && inPicture === shown.inPicture) return;
    shown = {lab, layer, inPicture};
    for (const figure of document.querySelectorAll(".pfslam-lab")) figure.lab?.stage.light(figure === lab && inPicture ? layer : "");
    for (const word of document.querySelectorAll("article [data-layer]")) {
      word.classList.toggle("pfslam-lit", word.dataset.layer === layer && labOf(word) === lab);
    }
  }

  const lightWord = word => light(word ? labOf(word) : undefined, word?.dataset.layer);

  /* The pointer is on a picture: light the words for what it points at. The picture stays as it is, so that it can be used. */
  function point(event) {
    const lab = event.target.closest?.(".pfslam-lab"), stage = lab?.lab?.stage;
    if (held || !stage || !event.target.matches("canvas:not([data-layer])")) return;
    const words = [...document.querySelectorAll("article span[data-layer]")].filter(word => labOf(word) === lab);
    light(lab, stage.under(event.target, event, words.map(word => word.dataset.layer)), false);
  }

  function hold(word) {
    held?.setAttribute("aria-pressed", "false");
    held = word === held ? null : word;
    held?.setAttribute("aria-pressed", "true");
    lightWord(held);
  }

  const wordAt = event => event.target.closest?.("article [data-layer]") ?? null;

  window.addEventListener("load", () => {
    for (const word of document.querySelectorAll("article span[data-layer]")) {
      if (!labOf(word)) continue;
      word.classList.add("pfslam-layer");
      word.style.setProperty("--layer", `var(--lab-${word.dataset.layer}, currentColor)`);
      for (const [name, value] of Object.entries({role: "button", tabindex: "0", "aria-pressed": "false"})) word.setAttribute(name, value);
      const formula = word.querySelector("math mrow"); // not every reader says what stands in MathML below a button
      if (formula) word.setAttribute("aria-label", formula.textContent);
    }
    document.addEventListener("pointerover", event => { if (event.pointerType !== "touch") lightWord(wordAt(event) ?? held); });
    document.addEventListener("pointermove", event => { if (event.pointerType !== "touch" && !event.buttons) point(event); });
    document.addEventListener("focusin", event => { if (event.target.matches(":focus-visible")) lightWord(wordAt(event) ?? held); });
    document.addEventListener("click", event => { if (wordAt(event)?.matches("[role=button]")) hold(wordAt(event)); });
    document.addEventListener("keydown", event => {
      const word = wordAt(event);
      if (event.key === "Escape" && held) hold(held);
      if (!word || (event.key !== "Enter" && event.key !== " ")) return;
      event.preventDefault();
      event.stopPropagation(); // a laboratory would take the key for one of its own
      hold(word);
    }, true);
  });
})();
