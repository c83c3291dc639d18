/* A formula that is wider than its column scrolls, and who has no mouse must be able to stand in it. */
(function () {
  "use strict";
  const formulas = document.querySelectorAll(".katex-display");

  function reach() {
    for (const formula of formulas) {
      if (formula.scrollWidth > formula.clientWidth) formula.tabIndex = 0;
      else formula.removeAttribute("tabindex");
    }
  }

  if (formulas.length) new ResizeObserver(reach).observe(document.body);
})();
