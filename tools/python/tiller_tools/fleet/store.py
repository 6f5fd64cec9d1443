"""Results on disk: a file for each job, with the signature of all that it depends on."""

from __future__ import annotations

import json
from pathlib import Path

from .files import FleetError, replace_file

# Exit codes that are answers. identify: 0. gap: its verdicts (docs/guide/gap.md).
ANSWERS = {"identify": (0,), "gap": (0, 1, 2, 3)}
IDENTIFY_KEYS = ("name", "parameters", "noise_scale", "process_scale", "effective_samples", "exponent", "transitions",
                 "refused", "gated", "diverged", "samples", "alarm", "residual_trends")
GAP_LEFT_OUT = ("windows", "traces", "maps", "rollouts", "curves", "figures")


def condense(what: str, text: bytes) -> dict:
    """Of a result what the fleet needs: of identify the candidate with everything, of gap all but the curves."""
    result = json.loads(text)
    if what == "gap":
        return {key: value for key, value in result.items() if key not in GAP_LEFT_OUT}
    last = result["candidates"][-1]
    kept = {key: last[key] for key in IDENTIFY_KEYS if key in last}
    return {"tiller": result["tiller"], "robot": result["robot"], "logs": result["logs"],
            "warnings": result["warnings"], **kept}


class Store:
    """The folder `results` of an output folder."""

    def __init__(self, out: Path, what: str):
        self.folder, self.what = out / "results", what
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FleetError(f"{self.folder}: cannot be made a folder: {error.strerror}; name another by -o") from None

    def path(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def get(self, name: str, signature: str) -> dict | None:
        """The result, if it is there, whole, and of the same inputs."""
        try:
            kept = json.loads(self.path(name).read_bytes())
        except (OSError, ValueError):
            return None
        return kept if isinstance(kept, dict) and kept.get("signature") == signature else None

    def put(self, name: str, signature: str, ran: dict) -> dict:
        """Keeps an answer, or the command's refusal: both are the same the next time. Returns what was kept."""
        kept: dict = {"signature": signature, "code": ran["code"]}
        if ran["code"] in ANSWERS[self.what]:
            kept["result"] = condense(self.what, ran["out"])
        else:
            kept["refusal"] = ran["err"].decode("utf-8", "replace").strip()[-2000:]
        replace_file(self.path(name), (json.dumps(kept, separators=(",", ":")) + "\n").encode())
        return kept
