/* A picture opens at its full size: by tap, by Enter, closed by tap, button or Escape. Explorers and laboratories have
   controls of their own. */
const dialog = document.body.appendChild(document.createElement("dialog"));
dialog.className = "pfslam-full";
dialog.setAttribute("aria-label", "Picture at full size");
dialog.addEventListener("click", () => dialog.close());
dialog.addEventListener("close", () => dialog.replaceChildren());

const openPicture = (image) => {
  const copy = document.createElement("img");
  copy.src = image.src;
  copy.alt = image.alt;
  const close = document.createElement("button");
  close.textContent = "Close";
  dialog.replaceChildren(copy, close);
  dialog.showModal();
  close.focus();
};

for (const image of document.querySelectorAll(".cell_output img.pfslam-picture")) {
  if (image.closest(".pfslam-explorer, .pfslam-lab, .pfslam-hero")) continue;
  image.classList.add("pfslam-zoom");
  image.tabIndex = 0;
  image.setAttribute("role", "button");
  image.title = "Open at full size";
  image.addEventListener("click", () => openPicture(image));
  image.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    openPicture(image);
  });
}
