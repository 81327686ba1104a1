// One time for the film, the twin and the picture in three dimensions.
const part = (id) => document.getElementById(id);
const video = JSON.parse(part("video-data").textContent), overlays = JSON.parse(part("overlay-data").textContent);
const stage = part("stage"), slider = part("frame"), fitted = Number(stage.dataset.fitted), count = video.times_s.length;
let camera = 0, timer = 0;

const jpeg = (data) => data && `data:image/jpeg;base64,${data}`;
const png = (data) => data && `data:image/png;base64,${data}`;
function put(image, address) {
  if (address) image.src = address;
  else image.removeAttribute("src");
}

function show() {
  const frame = Number(slider.value), shot = video.cameras[camera].shots[frame], overlay = overlays[camera][frame];
  put(stage.querySelector(".film .picture"), shot && jpeg(shot.picture));
  put(stage.querySelector(".simulated .picture"), overlay && jpeg(overlay.twin));
  for (const image of stage.querySelectorAll(".outlines")) put(image, overlay && part("outlined").checked && png(overlay.outlines));
  part("time").textContent = `frame ${frame} of ${count - 1}, ${video.times_s[frame].toFixed(3)} s${frame < fitted ? "" : ", predicted"}`;
  document.querySelectorAll("#cameras .camera").forEach((button, i) => {
    const own = video.cameras[i].shots[frame], seen = overlays[i][frame];
    button.classList.toggle("chosen", i === camera);
    put(button.querySelector("img"), own && jpeg(own.picture));
    button.querySelector(".overlap").textContent = seen ? `${(100 * seen.iou).toFixed(0)} %` : "no picture";
  });
}

// From the slider here, or from the viewer.
function setFrame(frame) {
  slider.value = frame;
  show();
  if (viewer.renderer && viewer.state.frame !== frame && frame < viewer.head.times_s.length) viewer.setFrame(frame);
}
function play() {
  clearInterval(timer);
  part("play").textContent = timer ? "play" : "stop";
  timer = timer ? 0 : setInterval(() => setFrame((Number(slider.value) + 1) % count), 150);
}

slider.addEventListener("input", () => setFrame(Number(slider.value)));
part("play").addEventListener("click", play);
part("outlined").addEventListener("change", show);
part("wiped").addEventListener("change", () => stage.classList.toggle("wiped", part("wiped").checked));
stage.querySelector(".wipe").addEventListener("input", (event) => stage.style.setProperty("--wipe", `${event.target.value}%`));
const enlarge = (large) => {
  stage.classList.toggle("large", large);
  part("enlarge").textContent = stage.classList.contains("large") ? "close" : "enlarge";
};
part("enlarge").addEventListener("click", () => enlarge());
for (const layers of stage.querySelectorAll(".layers")) layers.addEventListener("click", () => enlarge());
addEventListener("keydown", (event) => { if (event.key === "Escape") enlarge(false); });
document.querySelectorAll("#cameras .camera").forEach((button, i) => button.addEventListener("click", () => { camera = i; show(); }));
if (viewer.renderer) viewer.onFrame((frame) => { if (frame < count && Number(slider.value) !== frame) { slider.value = frame; show(); } });
show();
