/* On paper nothing unfolds: answers and solutions stand at the end of the chapter, as in a printed textbook. A Story has none. */
(function () {
  "use strict";
  const FOLDS = "article .admonition.dropdown, article .cell[class*='tag_solution-']";
  let atTheEnd = null;

  function element(name, text, className) {
    const made = document.createElement(name);
    made.textContent = text;
    made.className = className || "";
    return made;
  }

  /* The bold words with which the question above begins, such as "2." or "Exercise 1." */
  function question(fold) {
    for (let above = fold.previousElementSibling; above; above = above.previousElementSibling) {
      const bold = above.matches("p") && above.querySelector(":scope > strong");
      if (bold && above.textContent.startsWith(bold.textContent)) return bold.textContent;
    }
    return "";
  }

  function section(fold) {
    const title = fold.closest("section")?.querySelector("h1, h2, h3");
    return title ? title.firstChild.textContent.trim() : "";
  }

  function unfolded(fold) {
    const inside = fold.querySelector("details") || fold;
    const copy = element("div", "", "pfslam-unfolded");
    for (const child of inside.children) {
      if (!child.matches("summary, .admonition-title")) copy.append(child.cloneNode(true));
    }
    return copy;
  }

  function moveToTheEnd() {
    putBack();
    const folds = document.documentElement.dataset.read === "story" ? [] : [...document.querySelectorAll(FOLDS)];
    if (!folds.length) return;
    atTheEnd = element("section", "", "pfslam-at-the-end");
    atTheEnd.append(element("h2", "Answers and solutions"));
    let last = null;
    for (const fold of folds) {
      if (section(fold) !== last) atTheEnd.append(element("h3", (last = section(fold))));
      const answer = unfolded(fold);
      const words = answer.firstElementChild;
      if (words?.matches("p")) words.prepend(element("strong", question(fold)), " ");
      else answer.prepend(element("p", question(fold), "pfslam-question"));
      atTheEnd.append(answer);
      fold.classList.add("pfslam-moved");
    }
    document.querySelector("article").append(atTheEnd);
  }

  function putBack() {
    atTheEnd?.remove();
    atTheEnd = null;
    for (const moved of document.querySelectorAll(".pfslam-moved")) moved.classList.remove("pfslam-moved");
  }

  window.addEventListener("beforeprint", moveToTheEnd);
  window.addEventListener("afterprint", putBack);
})();
