"""What `tiller tune` says of a search."""
from __future__ import annotations

import math

from .search import Options, Tuned, seeds_text
from .trial_log import Trial


def cell(trial: Trial) -> str:
    return f"{trial.mean:.4g} +- {trial.sd:.2g}" + (f" ({trial.safe} SAFE)" if trial.safe else "")


def progress_text(o: Options, index: int, trials: list[Trial]) -> str:
    best = max(range(len(trials)), key=lambda k: (trials[k].mean, -k))
    now = trials[index]
    what = f"refused: {now.refused.strip()}" if now.refused else f"return {cell(now)}"
    return f"trial {index + 1} of {o.trials}: {what}; best {trials[best].mean:.4g} (trial {best + 1})"


def _gain(before: Trial, after: Trial) -> str:
    """Seed against seed: the plants' differences cancel."""
    gain = Trial([], [b - a for a, b in zip(before.scores, after.scores, strict=True)])
    if not gain.scores or not math.isfinite(gain.mean):
        return "  a plant's state was not finite on the other seeds: no difference can be given\n"
    if len(gain.scores) < 2:
        return f"on the other seed: {gain.mean:+.4g}; one seed tells no error: raise --test\n"
    error = gain.sd / math.sqrt(len(gain.scores))
    better = sum(g > 0 for g in gain.scores)
    text = (f"on the other seeds, seed against seed: {gain.mean:+.4g} +- {error:.2g} (standard error), better on "
            f"{better} of {len(gain.scores)}\n")
    if gain.mean < 2 * error:
        text += "that is within two standard errors: more --train seeds, or more --trials, before it is believed\n"
    return text


def report_text(o: Options, result: Tuned) -> str:
    trained = "trained on " + seeds_text(o.first_seed, o.train)
    others = "others: " + seeds_text(o.first_seed + o.train, o.test)
    assert result.before
    text = ("return (minus the mean stage cost of the robot file as it was), mean +- deviation over seeds\n"
            f"  {'':8} {trained:>26} {others:>26}\n"
            f"  {'before':8} {cell(result.trials[0]):>26} {cell(result.before):>26}\n")
    if not result.after:
        return text + (f"none of {len(result.trials) - 1} trials is better than the robot file as it is; widen "
                       "--search, or raise --trials\n")
    best = result.trials[result.best]
    text += f"  {'after':8} {cell(best):>26} {cell(result.after):>26}\n" + _gain(result.before, result.after)
    for key, before, after in zip(o.keys, result.trials[0].values, best.values, strict=True):
        text += f"  {key.path:32} {before or '(default)':>14} -> {after}\n"
    return text
