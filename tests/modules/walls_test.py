"""modules.py finds each kind of broken wall in a small tree, and nothing in a sound one."""

import pathlib
import tempfile
import unittest

import modules


class Walls(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        for path, text in {"runtime/core/ring.hpp": "", "runtime/io/bus.hpp": '#include "core/ring.hpp"\n',
                           "tools/run/run.cpp": '#include "io/bus.hpp"\n#include "core/ring.hpp"\n#include <vector>\n',
                           "tools/run/run.hpp": ""}.items():
            (self.root / path).parent.mkdir(parents=True, exist_ok=True)
            (self.root / path).write_text(text)
        self.links = {"runtime/core": set(), "runtime/io": {"runtime/core"}, "tools/run": {"runtime/io"}}

    def test_sound(self):
        self.assertEqual(modules.upward_links(self.links), [])
        self.assertEqual(modules.circles(self.links), [])
        self.assertEqual(list(modules.stray_includes(self.root, self.links)), [])

    def test_upward(self):
        self.links["runtime/core"].add("tools/run")
        self.assertEqual(modules.upward_links(self.links), [("runtime/core", "tools/run")])

    def test_circle(self):
        self.links["runtime/core"].add("runtime/io")
        self.assertEqual(modules.circles(self.links), ["runtime/core", "runtime/io"])

    def test_include_that_is_not_linked(self):
        (self.root / "runtime/io/bus.hpp").write_text('#include "tools/run/run.hpp"\n')
        self.assertEqual(list(modules.stray_includes(self.root, self.links)), [("runtime/io/bus.hpp", "tools/run/run.hpp")])

    def test_stale_table(self):
        rows = modules.table(self.root, self.links)
        self.assertEqual(list(modules.stale(rows, rows)), [])
        self.links["tools/run"] = {"runtime/core"}
        self.assertTrue(any("tools/run" in line for line in modules.stale(rows, modules.table(self.root, self.links))))


if __name__ == "__main__":
    unittest.main()
