"""full_disk_run_test.py TILLER ROBOT TYPES: what a run over LCM says while its disk is full.

A small tmpfs is the disk, in a mount namespace of the run's own; where the machine forbids that, a limit on the size of
files alone stands in for it, which can be set for a program from outside, and lifted again. Run in a network namespace.
"""
import pathlib
import resource
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import lcm

TILLER, ROBOT, TYPES = sys.argv[1:4]
sys.path.insert(0, TYPES)
from tiller_lcm import telemetry_t  # noqa: E402

OK, IO_ERROR = 0, 113
UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)


class Listener:
    """The newest telemetry, whoever sends it."""

    def __init__(self):
        self.bus = lcm.LCM()
        self.bus.subscribe("TILLER_TELEMETRY", self.take)
        self.newest = None

    def take(self, _, data):
        self.newest = telemetry_t.decode(data)

    def until(self, holds, seconds=60):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.bus.handle_timeout(100)
            while self.bus.handle_timeout(0):
                pass
            if self.newest is not None and holds(self.newest):
                return self.newest
        raise AssertionError("not told within a minute")


MAY_MOUNT = subprocess.run(["unshare", "-m", "sh", "-c", "mount -t tmpfs -o size=64k tmpfs /mnt"], check=False,
                           stderr=subprocess.DEVNULL).returncode == 0


class Run:
    """Plant and runtime in lockstep over LCM. `file_bytes`: no file may be larger; `disk_bytes`: the disk at folder/disk."""

    def __init__(self, folder, *options, file_bytes=None, disk_bytes=None):
        self.plant = subprocess.Popen([TILLER, "sim", ROBOT, "--serve", "lcm", "--lockstep", "--answer-timeout", "20"],
                                      stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        limit = (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, resource.RLIM_INFINITY))) if file_bytes else None
        mount = []
        if disk_bytes:
            (folder / "disk").mkdir()
            mount = ["unshare", "-m", "sh", "-c", f"mount -t tmpfs -o size={disk_bytes} tmpfs disk && "
                     "dd if=/dev/zero of=disk/ballast bs=4096 count=12 2>/dev/null && exec \"$@\"", "sh"]
        self.runtime = subprocess.Popen(
            [*mount, TILLER, "run", ROBOT, "--transport", "lcm", "--arm", "--lockstep", "--wait", "60", "--alarm-seconds", "0",
             *options], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, preexec_fn=limit)

    def end(self):
        self.runtime.send_signal(signal.SIGINT)
        text, _ = self.runtime.communicate(timeout=60)
        return self.runtime.returncode, text

    def kill(self):
        for process in (self.plant, self.runtime):
            if process.poll() is None:
                process.kill()
            process.wait()
        self.runtime.stdout.close()


class FullDisk(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.listener = Listener()

    def start(self, *options, **limits):
        run = Run(self.folder, *options, **limits)
        self.addCleanup(run.kill)
        return run

    def test_a_full_disk_is_in_the_telemetry_for_as_long_as_it_lasts(self):
        run = self.start("--record", "run.mcap", "--log", "run.csv", file_bytes=150000)
        well = self.listener.until(lambda t: t.tick >= 2)
        self.assertEqual((well.log_status, well.log_waiting_bytes), (OK, 0))
        full = self.listener.until(lambda t: t.log_status != OK)
        self.assertEqual((full.log_status, full.log_dropped_ticks, full.log_lost_bytes), (IO_ERROR, 0, 0))
        self.assertGreater(full.log_waiting_bytes, 0)
        self.assertEqual(full.first_fault, 0, "the robot goes on")
        # counted at each try to write, which come by the wall clock, not by ticks
        self.listener.until(lambda t: t.tick > full.tick + 200 and t.log_waiting_bytes > full.log_waiting_bytes)
        resource.prlimit(run.runtime.pid, resource.RLIMIT_FSIZE, UNLIMITED)
        freed = self.listener.until(lambda t: t.log_status == OK)
        self.assertEqual(freed.log_waiting_bytes, 0)
        code, text = run.end()
        self.assertEqual(code, 0, text)
        self.assertRegex(text, r"run\.mcap: cannot be written: File too large; the run goes on")
        self.assertRegex(text, r"at \d+\.\d\d s: a disk takes no more of the logs")
        self.assertRegex(text, r"at \d+\.\d\d s: the logs are complete again")
        self.assertIn("it could be completed at the end of the run", text)
        again = subprocess.run([TILLER, "replay", "run.mcap", ROBOT], cwd=self.folder, capture_output=True, text=True,
                               timeout=120, check=False)
        self.assertEqual(again.returncode, 0, again.stdout + again.stderr)
        self.assertIn(", 0 different", again.stdout)

    @unittest.skipUnless(MAY_MOUNT, "this machine forbids mount namespaces: the limit on files stands in for a disk")
    def test_a_disk_that_is_full_and_freed(self):
        run = self.start("--record", "disk/run.mcap", "--record", "disk/run.lcm", disk_bytes=200000)
        full = self.listener.until(lambda t: t.log_status != OK)
        self.assertEqual((full.log_status, full.log_dropped_ticks, full.log_lost_bytes), (IO_ERROR, 0, 0))
        inside = ["nsenter", "-t", str(run.runtime.pid), "-m", "sh", "-c"]
        subprocess.run([*inside, f"cd '{self.folder}' && rm disk/ballast && mount -o remount,size=50m disk"], check=True)
        self.listener.until(lambda t: t.log_status == OK and t.log_waiting_bytes == 0)
        code, text = run.end()
        self.assertEqual(code, 0, text)
        self.assertRegex(text, r"cannot be written: No space left on device; the run goes on")
        self.assertRegex(text, r"at \d+\.\d\d s: the logs are complete again")

    def test_one_that_stays_full_ends_with_2(self):
        run = self.start("--record", "/dev/full", "--log", "run.csv")
        first = self.listener.until(lambda t: True)
        self.assertEqual(first.log_status, IO_ERROR, "from the first tick on")
        self.listener.until(lambda t: t.tick > 100)
        code, text = run.end()
        self.assertEqual(code, 2, text)
        self.assertRegex(text, r"  logs: io_error: 0 ticks dropped, 0 bytes given up, [1-9]\d+ not written\n")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
