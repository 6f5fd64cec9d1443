"""A viewer that stands still, or dies, changes neither a command nor the number of ticks."""

import sys
import textwrap
import unittest

from rig import Run

# the interpreter of the viewer: once it has said that rows may come, it does what WHAT says
HAND = """\
    #!{python}
    import os, signal, sys
    sys.path[:0] = os.environ.get("PYTHONPATH", "").split(":")
    from tiller_tools import view

    begin = view.Input.begin

    def ready(self):
        begin(self)
        {what}

    view.Input.begin = ready
    sys.exit(view.main(sys.argv[3:]))
"""


class Faults(Run):
    alone = []  # the rows of a run without a viewer

    def hand(self, what):
        path = self.folder / "viewer"
        path.write_text(textwrap.dedent(HAND).format(python=sys.executable, what=what), encoding="utf-8")
        path.chmod(0o755)
        return str(path)

    def repeatable(self, log):
        return [{name: value for name, value in row.items() if name != "tick_us"} for row in self.rows(log)]

    def undisturbed(self, what):
        """What the run with that viewer tells; its CSV is that of a run without one."""
        told = self.steer("--view", "rerun", "--view-file", "seen.rrd", log="seen.csv", seconds=2,
                          TILLER_PYTHON=self.hand(what))
        if not Faults.alone:
            self.steer(log="alone.csv", seconds=2)
            Faults.alone = self.repeatable("alone.csv")
        self.assertEqual(len(Faults.alone), 100)
        self.assertEqual(self.repeatable("seen.csv"), Faults.alone)
        shown, dropped = self.counted(told)
        self.assertEqual(shown + dropped, 100)
        return told, dropped

    def test_it_is_stopped(self):
        told, dropped = self.undisturbed("os.kill(os.getpid(), signal.SIGSTOP)")
        self.assertIn("did not answer at the end and was ended", told)
        self.assertGreater(dropped, 0, "the queue holds less than all")

    def test_it_dies(self):
        told, dropped = self.undisturbed("os._exit(3)")
        self.assertIn("the viewer ended before the run", told)
        self.assertGreater(dropped, 0)


if __name__ == "__main__":
    unittest.main()
