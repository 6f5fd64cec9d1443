"""Headless Chromium on one page, its profile and logs in a folder of its own."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
from matplotlib import image

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
OPTIONS = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run",
           "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
           "--force-device-scale-factor=1", "--host-resolver-rules=MAP * ~NOTFOUND")
# What the browser asks for itself, whatever page it shows.
BROWSERS_OWN = re.compile(r"https?://([a-z0-9.-]+\.)?(google\.com|googleapis\.com|gvt1\.com|gstatic\.com)/")

# Runs in the page after it was laid out: where everything stands, in CSS pixels.
_PROBE = """
<script>
(() => {
  const box = (e) => { const b = e.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; };
  const all = (root, selector) => [...root.querySelectorAll(selector)];
  const figures = all(document, "figure").map((f) => {
    const svg = f.querySelector("svg");
    const labels = (which) => all(svg, `g[id*="-${which}_"]`).filter((g) => g.textContent.trim())
      .map((g) => g.textContent.trim());
    return {
      title: f.querySelector("h3") ? f.querySelector("h3").textContent : "",
      svg: box(svg),
      plots: all(svg, 'g[id*="-axes_"]').map((g) => box(g.querySelector('g[id*="-patch_"]'))),
      legends: all(svg, 'g[id*="-legend_"]').map(box),
      legend: all(svg, 'g[id*="-legend_"] text').map((t) => t.textContent),
      x: labels("xlabel"), y: labels("ylabel"),
      texts: all(svg, "text").filter((t) => t.textContent.trim()).map((t) => [t.textContent, ...box(t)]),
    };
  });
  const wide = all(document, "body *").filter((e) => !e.closest("svg, .scroll") &&
      (e.getBoundingClientRect().right > document.documentElement.clientWidth + 1 ||
       e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1)).map((e) => e.tagName + ": " + e.textContent.slice(0,
       60));
  const out = document.createElement("pre");
  out.id = "probe";
  out.style.display = "none";
  const height = document.body.getBoundingClientRect().bottom;
  out.textContent = JSON.stringify({figures, wide, text: document.body.innerText, height});
  document.body.appendChild(out);
})();
</script>"""


class Browser:
    def __init__(self, folder: Path, page_file: Path):
        self.folder, self.page = folder, page_file

    def _run(self, *options: str, url: str = "") -> subprocess.CompletedProcess:
        command = [CHROMIUM, *OPTIONS, f"--user-data-dir={self.folder / 'profile'}", "--enable-logging=stderr", *options,
                   url or self.page.as_uri()]
        # long beyond what any machine takes: it ends a browser that hangs
        return subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)

    def screenshot(self) -> np.ndarray:
        file = self.folder / "page.png"
        self._run("--window-size=1300,2400", f"--screenshot={file}")
        return image.imread(file)[:, :, :3]

    def look(self, width: int = 1200, height: int = 14000) -> tuple[dict, np.ndarray]:
        """What the probe finds, and a picture of it: (rows x columns x 3), 0 .. 1."""
        probed, file = self.folder / "probed.html", self.folder / "probed.png"
        text = self.page.read_text(encoding="utf-8").replace("</body>", _PROBE + "</body>")
        probed.write_text(text, encoding="utf-8")
        run = self._run(f"--window-size={width},{height}", f"--screenshot={file}", "--dump-dom", url=probed.as_uri())
        found = re.search(r'<pre id="probe"[^>]*>(.*?)</pre>', run.stdout, re.S)
        if not found:
            raise RuntimeError(f"the browser showed nothing of {self.page}: {run.stderr[-2000:]}")
        text = found.group(1).replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
        return json.loads(text), image.imread(file)[:, :, :3]

    def load(self) -> tuple:
        """The document as it stands after loading, messages of the console, addresses that the page asked for."""
        log = self.folder / "net.json"
        run = self._run("--window-size=1300,2400", f"--log-net-log={log}", "--dump-dom")
        console = [line for line in run.stderr.splitlines() if "CONSOLE" in line]
        text = log.read_text()
        try:
            events = json.loads(text)["events"]
        except json.JSONDecodeError:  # the browser was gone before it closed the list
            events = json.loads(text[:text.rindex("},") + 1] + "]}")["events"]
        asked = {event["params"]["url"] for event in events if "url" in (event.get("params") or {})}
        return run.stdout, console, sorted(url for url in asked if re.match(r"(https?|wss?|ftp):", url)
                                           and not BROWSERS_OWN.match(url))
