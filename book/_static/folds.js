/* The button of a folded answer is called by the title that it opens; the theme calls all of them the same. */
window.addEventListener("load", () => {
  for (const button of document.querySelectorAll("button.toggle-button")) {
    const title = button.closest(".admonition")?.querySelector(".admonition-title");
    if (title) button.setAttribute("aria-label", title.textContent.trim());
  }
});
