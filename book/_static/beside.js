/* On a wide screen the questions about a laboratory stand beside it, and it stays in sight while they are read, if it fits into the window. */
(function () {
  "use strict";
  const HEAD = 64; // px, where the page's own head ends

  function block(name, ...children) {
    const made = document.createElement("div");
    made.className = name;
    made.append(...children);
    return made;
  }

  /* What follows a laboratory up to the last folded answer before other code or another section. */
  function questions(cell) {
    const found = [];
    for (let next = cell.nextElementSibling; next && !next.matches(".cell, section"); next = next.nextElementSibling) found.push(next);
    return found.slice(0, found.findLastIndex(part => part.matches(".admonition.dropdown")) + 1);
  }

  for (const lab of document.querySelectorAll("article .cell figure.pfslam-lab")) {
    const cell = lab.closest(".cell"), words = questions(cell);
    if (!words.length) continue;
    const beside = block("pfslam-beside full-width"); // by its second name the theme knows to fold its table of contents
    cell.before(beside);
    beside.append(cell, block("pfslam-questions", ...words));
    const fit = () => cell.classList.toggle("pfslam-stays", HEAD + lab.offsetHeight <= window.innerHeight);
    new ResizeObserver(fit).observe(lab);
    window.addEventListener("resize", fit);
  }
})();
