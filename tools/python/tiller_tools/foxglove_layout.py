"""A Foxglove layout for a recording: python -m tiller_tools.foxglove_layout run.mcap -o run.layout.json

Foxglove reads it by "Import from file". One plot for what was measured and where the estimate is, one for the
commands, one for each parameter's mean with its deviation, one for the forces beyond the model, one for the time of a
tick, and the tick itself as a table.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .channels import field_names
from .table import ReportError, write_page


def plot(title: str, paths: list[str]) -> dict:
    lines = [{"value": path, "enabled": True, "timestampMethod": "publishTime"} for path in paths]
    return {"title": title, "paths": lines, "showXAxisLabels": True, "showYAxisLabels": True, "showLegend": True,
            "legendDisplay": "floating", "isSynced": True, "xAxisVal": "timestamp", "sidebarDimension": 240}


def below(channels: list, prefix: str) -> list[str]:
    """What follows `prefix` in the channels' names."""
    return [name.removeprefix(prefix) for name in channels if name.startswith(prefix)]


def values_of(channels: list, topic: str) -> list[str]:
    return [f"/{topic}.{name}" for name in below(channels, topic + ".")
            if not name.endswith(("_us", "sequence"))]


def panels(channels: list) -> dict:
    """Id -> configuration, from top to bottom. Of `tick.mean`, what has a deviation beside it is a parameter."""
    parameters = below(channels, "tick.sd.")
    states = [name for name in below(channels, "tick.mean.") if name not in parameters]
    made = {"Plot!states": plot("measured and estimated", values_of(channels, "measurement") +
                                [f"/tick.mean.{name}" for name in states]),
            "Plot!command": plot("commands", values_of(channels, "command"))}
    for name in parameters:
        quoted = f'"{name}"' if "." in name else name
        made[f"Plot!{name}"] = plot(name, [f"/tick.mean.{quoted}", f"/tick.sd.{quoted}"])
    if forces := below(channels, "tick.force.mean."):
        made["Plot!force"] = plot("forces beyond the model", [f"/tick.force.{kind}.{name}" for name in forces
                                                              for kind in ("mean", "sd")])
    made["Plot!tick"] = plot("nanoseconds of a tick", ["/tick.tick_ns"])
    made["RawMessages!tick"] = {"topicPath": "/tick", "diffEnabled": False, "expansion": "none"}
    return made


def stacked(ids: list[str]) -> dict | str:
    """Panels one below the other, of equal height."""
    if len(ids) == 1:
        return ids[0]
    return {"first": ids[0], "second": stacked(ids[1:]), "direction": "column", "splitPercentage": 100 / len(ids)}


def layout(path: Path) -> str:
    made = panels(field_names(path))
    return json.dumps({"configById": made, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1},
                       "layout": stacked(list(made))}, indent=1) + "\n"


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.foxglove_layout", description="A Foxglove layout of a log.")
    parser.add_argument("mcap")
    parser.add_argument("-o", "--out", required=True)
    options = parser.parse_args(argv)
    try:
        write_page(options.out, layout(Path(options.mcap)))
    except ReportError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
