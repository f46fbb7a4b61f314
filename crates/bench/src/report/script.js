for (const input of document.querySelectorAll(".over input")) {
  const place = () => input.parentElement.style.setProperty("--at", input.value + "%");
  input.addEventListener("input", place);
  place();
}
const chooser = document.getElementById("row");
if (chooser) {
  const choose = () => {
    for (const part of document.querySelectorAll("[data-row]")) part.hidden = part.dataset.row !== chooser.value;
  };
  chooser.addEventListener("change", choose);
  choose();
}
