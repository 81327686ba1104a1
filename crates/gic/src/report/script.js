const slider = document.getElementById("frame");
const label = document.getElementById("time");
const figures = [...document.querySelectorAll(".views figure")];
function put(image, jpeg) {
  image.hidden = !jpeg;
  image.src = jpeg ? "data:image/jpeg;base64," + jpeg : "";
}
function show() {
  const f = Number(slider.value);
  label.textContent = `frame ${f}, ${TIMES[f].toFixed(3)} s` + (f < FITTED ? "" : ", predicted");
  figures.forEach((figure, camera) => {
    const view = VIEWS[camera][f];
    put(figure.querySelector(".outlines"), view && view.jpeg);
    put(figure.querySelector(".look"), view && view.look);
    figure.querySelector("span").textContent = view ? `IoU ${view.iou.toFixed(3)}` : "no picture";
  });
}
if (slider) {
  slider.addEventListener("input", show);
  let timer = null;
  document.getElementById("play").addEventListener("click", () => {
    if (timer) { clearInterval(timer); timer = null; return; }
    timer = setInterval(() => { slider.value = (Number(slider.value) + 1) % TIMES.length; show(); }, 150);
  });
  show();
}
