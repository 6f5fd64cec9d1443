"""coverage.py BUILD_FOLDER JOBS: what the tests of a build with --coverage reached of runtime/.

Writes BUILD_FOLDER/coverage.html (a page per file beside it) and prints lines and branches of every folder. A line that
is compiled several times, by a template or for several programs, counts once and is reached where any copy is.
"""
import collections
import json
import pathlib
import subprocess
import sys


def run_gcovr(build, jobs, summary):
    page = build / "coverage.html"
    command = [
        pathlib.Path(sys.executable).parent / "gcovr", "--root", ".", "--object-directory", build, "-j", jobs,
        "--filter", "runtime/", "--exclude", ".*/osqp_port/.*", "--exclude", ".*/generated/.*",
        "--merge-mode-functions", "separate", "--exclude-throw-branches",
        "--exclude-unreachable-branches",
        # threads and loops of billions: a count may be wrong, but is not zero where the line was reached
        "--gcov-ignore-parse-errors", "negative_hits.warn_once_per_file",
        "--gcov-ignore-parse-errors", "suspicious_hits.warn_once_per_file",
        "--json-summary", summary, "--html-nested", page, "--html-title", "tiller: runtime", build,
    ]
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)


def percent(part, whole):
    return f"{100.0 * part / whole:5.1f}" if whole else "    -"


def row(name, c):
    return (f"{name:<12}{c['line_total']:>8}{percent(c['line_covered'], c['line_total']):>8}"
            f"{c['line_total'] - c['line_covered']:>8}{c['branch_total']:>10}"
            f"{percent(c['branch_covered'], c['branch_total']):>8}")


def main():
    build, jobs = pathlib.Path(sys.argv[1]), sys.argv[2]
    summary = build / "coverage.json"
    run_gcovr(build, jobs, summary)
    folders, total = collections.defaultdict(collections.Counter), collections.Counter()
    for file in json.loads(summary.read_text())["files"]:
        counts = {key: file[key] for key in ("line_total", "line_covered", "branch_total", "branch_covered")}
        parts = pathlib.PurePath(file["filename"]).parts  # of a header, by the link that it was included through
        folders[parts[parts.index("include_roots") + 1 if "include_roots" in parts else 1]].update(counts)
        total.update(counts)
    print(f"{'runtime/':<12}{'lines':>8}{'%':>8}{'missed':>8}{'branches':>10}{'%':>8}")
    for name in sorted(folders):
        print(row(name, folders[name]))
    print(row("total", total))


main()
