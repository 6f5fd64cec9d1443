"""site_test.py SOURCE FOLDER: the documentation's site as a person reads it, opened from its files in Chromium.

On a phone, a laptop and a wide screen nothing is cut that cannot be scrolled; search finds from files what people ask
for; the navigation goes a user's way; versions lie side by side. The site stays in FOLDER.
"""

import html
import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

SOURCE, FOLDER = Path(sys.argv[1]), Path(sys.argv[2])
sys.path[:0] = [str(SOURCE / "tests/pages"), str(SOURCE / "tools/dev")]

import site_versions  # noqa: E402
from browser import CHROMIUM, OPTIONS  # noqa: E402

WIDTHS = (390, 1300, 1920)
GROUPS = ["First hour", "Your own robot", "Motors", "Learning", "Trouble", "Reference", "Theory", "Measured", "Project"]
# What a person types, and the page that must be among the first three.
QUESTIONS = {"quick start": "guide/quick_start.html", "process_sd": "guide/process_sd.html",
             "goes safe": "guide/trouble.html", "controller tick": "api/python.html", "urdf": "guide/import.html",
             "glossary": "reference/glossary.html", "budget sigma": "guide/gap.html"}

# Of a document in a frame: what ends beyond the column that holds it and stands in nothing that scrolls; on a laptop and
# wider, tables that only a bar would show whole.
PROBE = """
const LAPTOP = 1300;
function cut(page) {
  const column = page.querySelector(".wy-nav-content").getBoundingClientRect();
  const scrolls = (e) => {
    for (let up = e.matches("pre") ? e : e.parentElement; up && !up.matches(".rst-content"); up = up.parentElement)
      if (/auto|scroll/.test(page.defaultView.getComputedStyle(up).overflowX))
        return up.getBoundingClientRect().right <= column.right + 1;
    return false;
  };
  const wide = [...page.querySelectorAll(".rst-content table")].filter((e) =>
    page.defaultView.innerWidth >= LAPTOP && e.getBoundingClientRect().width > column.width);
  return wide.concat([...page.querySelectorAll(".rst-content :is(table, pre, img, code, p, li, h1, h2, h3, h4)")].filter((e) => {
    const box = e.getBoundingClientRect();
    const spills = e.matches("p, li, h1, h2, h3, h4") && e.scrollWidth > e.clientWidth + 1;
    return box.width && (spills || box.right > column.right + 1 || box.left < column.left - 1) && !scrolls(e);
  })).map((e) => `${e.tagName} ${Math.round(e.getBoundingClientRect().right - column.right)} px: ` +
    e.textContent.trim().slice(0, 50));
}
"""


def browse(name: str, page: str, *options: str) -> dict:
    """Runs a page of ours whose script puts its findings into <pre id="found">, and gives them."""
    file = FOLDER / f"{name}.html"
    file.write_text(page, encoding="utf-8")
    command = [CHROMIUM, *OPTIONS, f"--user-data-dir={FOLDER / 'profile'}", "--virtual-time-budget=100000",
               "--window-size=2000,1400", *options, "--dump-dom", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.S)
    if not found:
        raise RuntimeError(f"the browser showed nothing of {file}: {done.stderr[-2000:]}")
    return json.loads(html.unescape(found[1]))


def what_is_cut(pages: list[str]) -> tuple[list[str], int]:
    """Every page in a frame of each width; a frame's file may be read by this flag alone."""
    found = browse("frames", f"""<!doctype html><body><pre id="found"></pre><script>{PROBE}
const pages = {json.dumps(pages)}, widths = {json.dumps(WIDTHS)}, faults = [];
let tables = 0;
(async () => {{
  const frame = document.createElement("iframe");
  frame.style = "border: 0; height: 1000px";
  document.body.appendChild(frame);
  for (const name of pages) {{
    await new Promise((loaded) => {{ frame.onload = loaded; frame.src = "html/" + name; }});
    for (const width of widths) {{
      frame.style.width = width + "px";
      faults.push(...cut(frame.contentDocument).map((fault) => `${{name}} at ${{width}} px: ${{fault}}`));
    }}
    tables += frame.contentDocument.querySelectorAll("table").length;
  }}
  document.getElementById("found").textContent = JSON.stringify({{faults, tables}});
}})();
</script></body>""", "--allow-file-access-from-files")
    return found["faults"], found["tables"]


def addresses(results: str) -> list[str]:
    """The pages that the site's page of results shows, best first."""
    return list(dict.fromkeys(re.sub(r"^\./|#.*", "", a) for a in re.findall(r'<h3><a href="([^"]*)"', results)))


def search_from_files(question: str) -> list[str]:
    """As a reader does who opens the page's file, without any flag that lets it fetch others."""
    address = (FOLDER / "html/search.html").as_uri() + "?q=" + question
    command = [CHROMIUM, *OPTIONS, f"--user-data-dir={FOLDER / 'profile'}", "--virtual-time-budget=20000", "--dump-dom",
               address]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    return addresses(done.stdout.partition('id="mkdocs-search-results"')[2])


def search_all(questions: list[str]) -> dict[str, list[str]]:
    found = browse("searches", f"""<!doctype html><body><pre id="found"></pre><script>
const found = {{}};
(async () => {{
  for (const question of {json.dumps(questions)}) {{
    const frame = document.createElement("iframe");
    document.body.appendChild(frame);
    await new Promise((loaded) => {{
      frame.onload = loaded;
      frame.src = "html/search.html?q=" + question.replaceAll(" ", "+");
    }});
    const results = () => frame.contentDocument.getElementById("mkdocs-search-results").innerHTML;
    for (let i = 0; i < 100 && !results().trim(); ++i) await new Promise((next) => setTimeout(next, 50));
    found[question] = results();
  }}
  document.getElementById("found").textContent = JSON.stringify(found);
}})();
</script></body>""", "--allow-file-access-from-files")
    return {question: addresses(results) for question, results in found.items()}


def search_faults() -> list[str]:
    found = search_all([*QUESTIONS, "zzqx"])
    faults = [f"search for '{question}': {page} is not among the first three: {found[question][:3]}"
              for question, page in QUESTIONS.items() if page not in found[question][:3]]
    if found["zzqx"]:
        faults.append("search finds what stands nowhere")
    if QUESTIONS["process_sd"] not in search_from_files("process_sd"):
        faults.append("search does not work from the site's files")
    return faults


def navigation_faults() -> list[str]:
    text = (FOLDER / "html/index.html").read_text(encoding="utf-8")
    menu = text[text.index('class="wy-menu'):text.index("</nav>")]
    groups = [html.unescape(g) for g in re.findall(r'class="caption-text">([^<]+)<', menu)]
    entries = re.findall(r'class="reference internal" href="([^"#]+)"', menu)
    faults = [] if groups == GROUPS else [f"the navigation's groups are {groups}"]
    if entries[:2] != ["contents.html", "guide/quick_start.html"]:
        faults.append(f"the quick start is not the first page: {entries[:3]}")
    if not 0 <= entries.index("guide/first_power_up.html") < entries.index("guide/actuators.html"):
        faults.append("the first power-up stands behind the drives")
    private = re.findall(r"\b_[a-z]\w*\.py|tiller\._\w+", (FOLDER / "html/api/python.html").read_text(encoding="utf-8"))
    classes = re.findall(r'<h2 id="[^"]*">(\w+)</h2>', (FOLDER / "html/api/python.html").read_text(encoding="utf-8"))
    if private or classes[:3] != ["Robot", "Controller", "Plant"]:
        faults.append(f"Python's interface begins with {classes[:3]} and shows {private[:3]}")
    return faults


def the_probe_sees() -> list[str]:
    """What is cut is found, what has a bar of its own is not, unless it is a table on a wide screen."""
    page = (FOLDER / "html/project/words.html").read_text(encoding="utf-8")
    wide = f"<p style='white-space: pre; overflow-wrap: normal'>{'W' * 400}</p>"
    (FOLDER / "html/project/broken.html").write_text(page.replace("<h1", wide + "<h1", 1), encoding="utf-8")
    table = f'<div class="table"><table><tr><td>{wide}</td></tr></table></div>'
    whole = page.replace("<h1", f"<pre>{'W' * 400}</pre>{table}<h1", 1)
    (FOLDER / "html/project/whole.html").write_text(whole, encoding="utf-8")
    try:
        broken, whole = what_is_cut(["project/broken.html"])[0], what_is_cut(["project/whole.html"])[0]
    finally:
        for name in ("broken", "whole"):
            (FOLDER / f"html/project/{name}.html").unlink()
    faults = [f"the probe does not see at {w} px what is cut" for w in WIDTHS
              if not any(f"at {w} px: P " in fault for fault in broken)]
    told = sorted(fault.partition(": ")[2][:5] for fault in whole)
    return faults + ([] if told == ["TABLE", "TABLE"] else [f"of what scrolls the probe says {whole}"])


def versions_faults() -> list[str]:
    """Sites of two versions: the choice leads to the same page, or to the first one where the other lacks the page."""
    whole, folder, lacks = FOLDER / "html", FOLDER / "sites", "project/upgrade.html"
    older = FOLDER / "older"
    for old in (folder, older):
        shutil.rmtree(old, ignore_errors=True)
    shutil.copytree(whole, older, ignore=shutil.ignore_patterns("upgrade.html"))
    site_versions.add(whole, "0.10.0", folder)
    site_versions.add(older, "0.9.0", folder)  # added later, and older all the same
    found = browse("versions", f"""<!doctype html><body><pre id="found"></pre><script>
const found = [];
(async () => {{
  for (const name of ["guide/can.html", {json.dumps(lacks)}]) {{
    const frame = document.createElement("iframe");
    document.body.appendChild(frame);
    const loaded = (act) => new Promise((done) => {{ frame.onload = done; act(); }});
    await loaded(() => {{ frame.src = "sites/0.10.0/" + name; }});
    const choice = frame.contentDocument.querySelector(".site-version select");
    found.push([...choice.options].map((o) => o.value).join(" "));
    choice.value = "0.9.0";
    await loaded(() => choice.dispatchEvent(new Event("change")));
    found.push(frame.contentWindow.location.href.replace(/.*sites./, ""));
  }}
  document.getElementById("found").textContent = JSON.stringify(found);
}})();
</script></body>""", "--allow-file-access-from-files")
    wanted = ["0.10.0 0.9.0", "0.9.0/guide/can.html", "0.10.0 0.9.0", "0.9.0/index.html"]
    return [] if found == wanted else [f"the choice of versions led to {found}, not {wanted}"]


def main() -> int:
    if not importlib.util.find_spec("mkdocs"):
        print("no mkdocs: ./dev setup installs it (tools/dev/requirements_site.txt)")
        return 77
    command = [sys.executable, SOURCE / "tools/dev/site.py", SOURCE, FOLDER]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    if built.returncode != 0:
        print(built.stdout + built.stderr)
        return 1
    if not CHROMIUM:
        print("no chromium: ./dev setup installs it")
        return 77
    pages = sorted(str(p.relative_to(FOLDER / "html")) for p in (FOLDER / "html").rglob("*.html"))
    cut, tables = what_is_cut(pages)
    faults = the_probe_sees() + cut + search_faults() + navigation_faults() + versions_faults()
    print("\n".join(faults))
    print(f"{len(pages)} pages, {tables} tables, {len(cut)} cut, {len(faults)} faults")
    return 1 if faults or tables < 100 else 0


if __name__ == "__main__":
    sys.exit(main())
