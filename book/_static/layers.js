/* Words and picture are one: a word that names a thing, in the text or below the picture, lights it in the laboratory and lights all words for it.
 * A pointer or the focus lights it while it is there; a press, by mouse, finger or key, until the next one or Escape. */
(function () {
  "use strict";
  let held = null, shown = null; // the word that was pressed; the one that is lit now

  /* The laboratory that a word speaks of: its own, that beside it, the next of its section, or the last before it. */
  function labOf(word) {
    const near = word.closest(".pfslam-lab, .pfslam-beside, section"), labs = near ? [...near.querySelectorAll(".pfslam-lab")] : [];
    if (near?.matches(".pfslam-lab")) return near;
    return labs.find(lab => word.compareDocumentPosition(lab) & Node.DOCUMENT_POSITION_FOLLOWING) ?? labs.at(-1);
  }

  function light(word) {
    if (word === shown) return;
    shown = word;
    const lab = word && labOf(word), layer = word?.dataset.layer;
    for (const figure of document.querySelectorAll(".pfslam-lab")) figure.lab?.stage.light(figure === lab ? layer : "");
    for (const other of document.querySelectorAll("article [data-layer]")) {
      other.classList.toggle("pfslam-lit", other.dataset.layer === layer && labOf(other) === lab);
    }
  }

  function hold(word) {
    held?.setAttribute("aria-pressed", "false");
    held = word === held ? null : word;
    held?.setAttribute("aria-pressed", "true");
    light(held);
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
    document.addEventListener("pointerover", event => { if (event.pointerType !== "touch") light(wordAt(event) ?? held); });
    document.addEventListener("focusin", event => { if (event.target.matches(":focus-visible")) light(wordAt(event) ?? held); });
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
