"""Opens a report and a viewer's page in headless Chromium, works their controls, and looks at what they show.

    apt-get install chromium; pip install playwright pillow numpy
    gic demo -o out/demo && gic view out/demo/run -o out/view.html
    python3 scripts/check_pages.py --report out/demo/run/report.html --view out/view.html --pictures out/pages
    python3 scripts/check_pages.py --speed out/view.html
    gic view --live out/demo/run -o out/live.html
    python3 scripts/check_pages.py --live out/live.html out/demo/run/twin.json --gic target/release/gic

Without a network: any request but for the page itself fails the check. `--pictures` keeps the screenshots, in light, in
dark and as printed. `--speed` turns the view, sorts and draws, and prints the time that a picture takes and the part of
the script in it; CHROMIUM names another browser, CHROMIUM_FLAGS other flags (for hardware: `--use-angle=default`).
"""

import argparse
import functools
import io
import json
import os
import pathlib
import subprocess
import tempfile

import numpy
from PIL import Image, ImageChops
from playwright.sync_api import sync_playwright

SOFTWARE = "--no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader"


def open_page(browser, path, address="", scheme="light", size=(1200, 900)):
    """A page, whose errors and requests are failures."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    page.on("pageerror", lambda error: fail(f"{path}: {error}"))
    page.on("console", lambda line: fail(f"{path}: {line.text}") if line.type == "error" else None)
    file = pathlib.Path(path).resolve().as_uri()
    page.on("request", lambda request: None if request.url.split("#")[0] == file or request.url.startswith("data:") else fail(f"{path} asks for {request.url[:80]}"))
    page.goto(f"{file}{address}")
    page.wait_for_timeout(800)
    return page


FAILURES = []


def fail(text):
    FAILURES.append(text)


def check(condition, text):
    if not condition:
        fail(text)


def vivid_share(element):
    """Share of the pixels of an element's screenshot that have a colour."""
    picture = Image.open(io.BytesIO(element.screenshot())).convert("RGB")
    low, high = (functools.reduce(pick, picture.split()) for pick in [ImageChops.darker, ImageChops.lighter])
    return sum(ImageChops.subtract(high, low).histogram()[45:]) / (picture.width * picture.height)


def check_report(browser, path, pictures):
    page = open_page(browser, path)
    text = lambda selector: page.locator(selector).first.inner_text()
    verdict = text("#verdict")
    check(verdict.endswith(".") and verdict.count("\n") == 0 and "video" in verdict, f"no sentence: {verdict}")
    check(page.locator("#estimate tbody tr").count() >= 4, "the table of estimates is short")
    check("_pa" not in text("#estimate") and "e5" not in text("#estimate"), "names and numbers are not for people")
    check(page.locator("#costs tbody tr").count() >= 4, "times and memory are empty")
    for heading in ["The film and the twin", "Estimate", "The twin in three dimensions", "How it was found", "Times and memory"]:
        check(page.locator("h2", has_text=heading).count() == 1, f"no heading {heading}")
    for chart in page.locator(".chart").all():
        check(chart.locator("figcaption").inner_text().strip(), "a chart without a title")
        labels = chart.locator("svg text").all_text_contents()
        check(len(labels) >= 4 and "NaN" not in " ".join(labels), f"axes: {labels}")
    frames = page.locator("#comparison .chart svg text").all_text_contents()
    check("frame" in frames and not any(label.endswith(".5") for label in frames), f"frames are not whole: {frames}")
    film, twin = ".film .picture", ".simulated .picture"
    natural = lambda selector: page.eval_on_selector(selector, "image => image.naturalWidth")
    check(natural(film) > 0 and natural(film) == natural(twin), "film and twin have no pictures of one size")
    first = page.get_attribute(film, "src")
    page.eval_on_selector("#frame", "slider => { slider.value = slider.max; slider.dispatchEvent(new Event('input')); }")
    check(page.get_attribute(film, "src") != first, "the slider does not change the film")
    last = page.evaluate("viewer.state.frame")
    check(last == int(page.get_attribute("#frame", "max")), "the viewer does not follow the slider")
    page.evaluate("viewer.setFrame(2)")
    check(page.input_value("#frame") == "2", "the slider does not follow the viewer")
    cameras = page.locator("#cameras .camera")
    if cameras.count() > 1:
        before = page.get_attribute(film, "src")
        cameras.nth(1).click()
        check(page.get_attribute(film, "src") != before, "another camera shows the same picture")
    page.locator(".film .layers").click()
    check(page.locator(".stage.large").count() == 1, "a click does not enlarge")
    page.keyboard.press("Escape")
    check(page.locator(".stage.large").count() == 0, "Escape does not close")
    page.check("#wiped")
    check(page.locator(".wipe").is_visible(), "no slider between film and twin")
    page.uncheck("#wiped")
    page.locator("#viewer").scroll_into_view_if_needed()
    page.wait_for_timeout(500)
    check(vivid_share(page.locator("#viewer canvas")) > 0.005, "the viewer in the report is empty")
    page.evaluate("scrollTo(0, 0)")
    background = lambda page: page.evaluate("getComputedStyle(document.body).backgroundColor")
    light = background(page)
    dark = open_page(browser, path, scheme="dark")
    check(background(dark) != light, "dark mode is not dark")
    narrow = open_page(browser, path, size=(420, 900))
    check(narrow.evaluate("document.documentElement.scrollWidth <= innerWidth + 1"), "a narrow window scrolls sideways")
    if pictures:
        page.screenshot(path=pictures / "report.png", full_page=True)
        dark.screenshot(path=pictures / "report-dark.png")
        narrow.screenshot(path=pictures / "report-narrow.png")
        page.pdf(path=pictures / "report.pdf", format="A4")
    print(f"{path}: {verdict}")


def check_view(browser, path, pictures):
    page = open_page(browser, path, size=(960, 640))
    canvas = page.locator("#viewer canvas")
    frame = lambda: int(page.input_value(".frame"))
    before = frame()
    page.keyboard.press("ArrowRight")
    check(frame() == before + 1, "an arrow key does not step before the page is touched")
    options = lambda selector: page.eval_on_selector_all(f"{selector} option", "list => list.map((o) => o.value)")
    check({"stress", "speed"} <= set(options(".mode")), f"meanings of the colours: {options('.mode')}")
    page.select_option(".mode", "stress")
    check(page.locator(".scale-of-colors").is_visible(), "no colour bar")
    check("von Mises stress [" in page.locator(".what").inner_text(), "a colour bar without a unit")
    page.evaluate("viewer.setFrame(viewer.head.times_s.length >> 1)")
    page.wait_for_timeout(300)
    shot = lambda: canvas.evaluate("canvas => canvas.toDataURL()")
    splats = shot()
    page.select_option(".drawing", "points")
    page.wait_for_timeout(300)
    check(shot() != splats, "points look like splats")
    page.select_option(".drawing", "splats")
    page.wait_for_timeout(300)
    check(shot() == splats, "splats are not drawn the same again")
    high = float(page.input_value(".high"))
    page.fill(".high", str(high / 10))
    page.keyboard.press("Enter")
    page.wait_for_timeout(300)
    check(shot() != splats, "the range of the colours does nothing")
    page.click(".auto")
    check(float(page.input_value(".high")) == high, "auto does not bring the range back")
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y + 30)
    page.mouse.up()
    page.wait_for_timeout(300)
    turned = shot()
    check(turned != splats, "a drag does not turn")
    page.keyboard.down("Shift")
    page.mouse.down()
    page.mouse.move(x, y)
    page.mouse.up()
    page.keyboard.up("Shift")
    page.mouse.wheel(0, -300)
    page.wait_for_timeout(300)
    check(shot() != turned, "neither shift and drag nor the wheel do anything")
    page.click(".reset")
    page.wait_for_timeout(300)
    check(shot() == splats, "reset does not bring the view back")
    frame = page.evaluate("viewer.state.frame")
    page.click(".forth")
    check(page.evaluate("viewer.state.frame") == frame + 1, "no step")
    page.select_option(".speed", "0.1")
    page.click(".play")
    page.wait_for_timeout(1500)
    page.click(".play")
    check(page.evaluate("viewer.state.frame") != frame + 1, "it does not play")
    check(page.locator(".overlay text").count() >= 4, "no axes or no scale")
    check(vivid_share(canvas) > 0.005, "nothing is drawn")
    cameras = options(".camera")
    if len(cameras) > 1:
        page.evaluate("viewer.setFrame(0)")
        page.select_option(".camera", "0")
        page.wait_for_timeout(600)
        with_film = shot()
        for behind in ["2", "0"]:
            page.select_option(".behind", behind)
            page.wait_for_timeout(300)
            check(shot() != with_film, f"behind the twin is always the film, not {behind}")
        page.select_option(".behind", "1")
        check_outline(page)
        if pictures:
            page.screenshot(path=pictures / "viewer-film.png")
        page.select_option(".camera", "")
    if pictures:
        page.select_option(".mode", options(".mode")[0])
        page.evaluate("viewer.setFrame(viewer.head.times_s.length >> 1)")
        page.wait_for_timeout(300)
        page.screenshot(path=pictures / "viewer.png")
    print(f"{path}: {page.evaluate('viewer.matter.splats')} splats, {page.evaluate('viewer.head.times_s.length')} frames")


def check_outline(page):
    """The twin through a camera of the scene covers the mask of that camera's picture at the first frame."""
    overlap = page.evaluate("""async () => {
      const { renderer } = viewer, { gl, canvas } = renderer;
      const drawn = (behind, opacity) => {
        document.querySelector(".behind").value = behind;
        document.querySelector(".opacity").value = opacity;
        viewer.draw();
        const pixels = new Uint8Array(4 * canvas.width * canvas.height);
        gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        return pixels;
      };
      document.querySelector(".floor").checked = false;
      const mask = drawn("2", 0), twin = drawn("0", 1), bare = drawn("0", 0);
      document.querySelector(".floor").checked = true;
      document.querySelector(".behind").value = "1";
      document.querySelector(".opacity").value = 1;
      viewer.draw();
      let both = 0, any = 0;
      for (let i = 0; i < mask.length; i += 4) {
        const inMask = mask[i + 1] > 110, inTwin = Math.abs(twin[i] - bare[i]) + Math.abs(twin[i + 1] - bare[i + 1]) + Math.abs(twin[i + 2] - bare[i + 2]) > 60;
        both += inMask && inTwin;
        any += inMask || inTwin;
      }
      return both / any;
    }""")
    print(f"overlap of the splats with the mask of the first camera, in the browser: {overlap:.3f}")
    check(overlap > 0.85, f"the splats lie beside the film: overlap {overlap:.3f}")


def simulate_here(page, twin_file, gic, frames):
    """The centres of mass [m] that gic itself finds for the particles of a live page, at the page's frames."""
    numbers = page.evaluate("""() => {
      const text = atob(document.getElementById("live-numbers").textContent);
      return [...new Float64Array(Uint8Array.from(text, (c) => c.charCodeAt(0)).buffer)]; }""")
    twin = json.loads(pathlib.Path(twin_file).read_text())
    count = int(numbers[1])
    density, volume, cell, rate = numbers[2 + count : 6 + count]
    particles = page.evaluate("viewer.simulation.particles")
    rows = numpy.array(numbers[-4 * particles :]).reshape(-1, 4)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        names = "".join(f"property double {name}\n" for name in ["x", "y", "z", "volume_factor"])
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {particles}\n{names}end_header\n"
        (folder / "body.ply").write_bytes(head.encode() + rows.astype("<f8").tobytes())
        twin |= {"continuum": "body.ply", "frame_rate_hz": rate, "grid_spacing_m": cell, "particle_spacing_m": volume ** (1 / 3)}
        twin.pop("substeps_per_frame", None)
        (folder / "twin.json").write_text(json.dumps(twin))
        subprocess.run([gic, "simulate", folder / "twin.json", "-o", folder / "out", "--frames", str(frames + 1)], check=True, capture_output=True)
        written = json.loads((folder / "out/trajectory.json").read_text())["frames"]
    return numpy.array([frame["centre_of_mass_m"] for frame in written])


def check_live(browser, path, twin, gic, pictures):
    page = open_page(browser, path, size=(1100, 720))
    page.evaluate("viewer.ready")
    page.evaluate("viewer.stop(); viewer.restart()")
    # Frames without drawing, and the centre of mass after each.
    run = lambda frames: numpy.array(page.evaluate("""(frames) => { const list = [viewer.simulation.centre];
      for (let i = 0; i < frames; i++) { viewer.simulation.call("gic_advance"); list.push(viewer.simulation.centre); }
      viewer.showMoment(); return list; }""", frames))
    down = numpy.array(page.evaluate("viewer.head.up"))
    free = run(90)
    height = free @ down
    low = int(height.argmin())
    check(height[0] - height[low] > 0.02, f"the body does not fall: {height}")
    rebound = height[low:].max() - height[low]
    if gic:
        ours = simulate_here(page, twin, gic, 90)
        drop = height[0] - height[low]
        difference = numpy.linalg.norm(free - ours, axis=1).max()
        print(f"{path}: falls {drop:.4f} m, rises {rebound:.4f} m; centre of mass within {1e6 * difference:.2f} um of gic simulate, {difference / drop:.1e} of the drop")
        check(difference < 1e-3 * drop, "the page does not simulate what gic does")
    page.evaluate("viewer.restart()")
    slider = page.locator(".parameters [type=range]").first
    slider.evaluate("slider => { slider.value = slider.max; slider.dispatchEvent(new Event('input')); }")
    changed = run(90)
    check(abs(changed - free).max() > 1e-3, "another first parameter changes nothing")
    slider.dispatch_event("dblclick")
    page.evaluate("viewer.restart()")
    check(abs(run(90) - free).max() == 0.0, "a double click does not bring the twin's own value back")
    page.select_option(".mode", "stress")
    page.wait_for_timeout(300)
    box = page.locator("#viewer canvas").bounding_box()
    x, y = page.evaluate("""() => { const { canvas, camera, simulation } = viewer, view = camera.view(canvas.width, canvas.height);
      const p = simulation.centre.map((c, i) => c - view.eye[i]), on = view.rows.map((row) => row[0] * p[0] + row[1] * p[1] + row[2] * p[2]);
      const ratio = window.devicePixelRatio; return [0, 1].map((i) => (view.focal[i] * on[i] / on[2] + view.principal[i]) / ratio); }""")
    before = page.evaluate("viewer.simulation.centre")
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + x + 60, box["y"] + y - 120, steps=8)
    page.wait_for_timeout(2500)
    lifted = page.evaluate("viewer.simulation.centre")
    if pictures:
        page.screenshot(path=pictures / "live.png")
    page.mouse.up()
    moved = float((numpy.array(lifted) - before) @ down)
    check(moved > 0.02, f"a pull does not lift: {moved}")
    page.wait_for_timeout(1500)
    check(vivid_share(page.locator("#viewer canvas")) > 0.005, "nothing is drawn")
    pace = page.evaluate("viewer.rate")
    page.evaluate("viewer.stop(); viewer.restart()")
    rate = page.evaluate("viewer.measureSimulation(90)")
    count = page.evaluate("viewer.simulation.particles")
    print(f"{path}: {count} particles, {rate:.0f} frames/s of the simulation alone, {pace:.2f} x true speed while it is drawn; a pull lifts it {moved:.3f} m")


def measure(browser, path):
    page = open_page(browser, path, size=(1280, 720))
    renderer = page.evaluate("""() => { const { gl } = viewer.renderer, info = gl.getExtension("WEBGL_debug_renderer_info");
      return info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "?"; }""")
    page.evaluate("viewer.measure(3)")
    splats, picture = page.evaluate("viewer.matter.splats"), page.evaluate("viewer.measure(20)")
    script = page.evaluate("""() => {
      const { matter, renderer } = viewer, start = performance.now();
      for (let i = 0; i < 20; i++) {
        matter.move(matter.frame(i % matter.frames).particles);
        const angle = 0.1 * i;
        renderer.sort({ eye: [0, 0, 2], rows: [0, 0, [Math.sin(angle), 0, -Math.cos(angle)]] });
      }
      return (performance.now() - start) / 20;
    }""")
    print(f"{path}: {splats} splats, 1280x720, {renderer}: {picture:.1f} ms a picture, of which the script takes {script:.1f} ms")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--report", action="append", default=[])
    parser.add_argument("--view", action="append", default=[])
    parser.add_argument("--speed", action="append", default=[])
    parser.add_argument("--live", nargs=2, action="append", default=[], metavar=("PAGE", "TWIN"))
    parser.add_argument("--gic", help="the program whose simulation live pages are compared with")
    parser.add_argument("--pictures", type=pathlib.Path)
    arguments = parser.parse_args()
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    flags = os.environ.get("CHROMIUM_FLAGS", SOFTWARE).split()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"), args=flags)
        for path in arguments.report:
            check_report(browser, path, arguments.pictures)
        for path in arguments.view:
            check_view(browser, path, arguments.pictures)
        for path, twin in arguments.live:
            check_live(browser, path, twin, arguments.gic, arguments.pictures)
        for path in arguments.speed:
            measure(browser, path)
        browser.close()
    for failure in FAILURES:
        print(f"FAILED: {failure}")
    raise SystemExit(bool(FAILURES))


if __name__ == "__main__":
    main()
