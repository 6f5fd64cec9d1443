"""lossy_lockstep_test.py TILLER ROBOT: plant and controller in lockstep, with a network between them that loses a third
of all messages, doubles a tenth and delays a tenth. Commands must be those of the run in one process, to the last bit.

A relay carries datagrams between two multicast groups, the plant's and the controller's. Run in a network namespace of
its own.
"""
import pathlib
import random
import re
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import unittest

TILLER, ROBOT = sys.argv[1:3]
PLANT, CONTROLLER = ("239.255.76.67", 7667), ("239.255.76.68", 7668)
TICKS, SECONDS = 100, 2
PATIENCE_S = 120  # only ever waited for in full by a test that fails


def listen(group):
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    receiver.bind(group)
    receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                        struct.pack("4s4s", socket.inet_aton(group[0]), socket.inet_aton("0.0.0.0")))
    receiver.settimeout(0.05)
    return receiver


class Relay:
    """Passes one channel from one group to the other."""

    def __init__(self, source, target, channel, seed):
        self.source, self.target, self.channel = listen(source), target, channel
        self.sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        self.random, self.delayed, self.seen, self.lost = random.Random(seed), [], 0, 0
        self.running = True
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        while self.running:
            try:
                packet = self.source.recv(4096)
            except TimeoutError:
                continue
            if packet[8:packet.index(b"\0", 8)].decode() != self.channel:
                continue
            for out in self.fate(packet):
                self.sender.sendto(out, self.target)

    def fate(self, packet):
        self.seen += 1
        chance = self.random.random()
        if chance < 0.33:
            self.lost += 1
            return []
        if chance < 0.43:
            self.delayed.append(packet)
            return []
        late, self.delayed = self.delayed, []
        return [packet] * (2 if chance < 0.53 else 1) + late

    def end(self):
        self.running = False
        self.thread.join()
        self.source.close()
        self.sender.close()


def bits(log):
    """Time, measurements and command of every tick."""
    return ["".join(line.split(",")[:4]) for line in pathlib.Path(log).read_text().splitlines()]


class LossyLockstep(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = pathlib.Path(self.folder.name)
        text = pathlib.Path(ROBOT).read_text()
        self.assertIn('kind = "lcm"\n', text)
        for name, group in (("plant", PLANT), ("controller", CONTROLLER)):
            url = f'kind = "lcm"\nurl = "udpm://{group[0]}:{group[1]}?ttl=0"\n'
            (self.path / f"{name}.toml").write_text(text.replace('kind = "lcm"\n', url))

    def tiller(self, *arguments):
        return subprocess.Popen([TILLER, *arguments], cwd=self.path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                text=True)

    def test_commands_are_those_of_one_process(self):
        alone = self.tiller("run", "plant.toml", "--sim", "--seconds", str(SECONDS), "--quiet", "--log", "alone.csv")
        told, _ = alone.communicate(timeout=PATIENCE_S)
        self.assertEqual(alone.returncode, 0, told)
        relays = [Relay(PLANT, CONTROLLER, "TILLER_MEASUREMENT", 1), Relay(CONTROLLER, PLANT, "TILLER_COMMAND", 2)]
        plant = self.tiller("sim", "plant.toml", "--serve", "lcm", "--lockstep", "--repeat", "0.02",
                            "--answer-timeout", "60", "--seconds", str(SECONDS))
        controller = self.tiller("run", "controller.toml", "--transport", "lcm", "--arm", "--lockstep", "--wait", "60",
                                 "--patience", "60", "--seconds", str(SECONDS), "--quiet", "--log", "run.csv",
                                 "--alarm-seconds", "0")
        try:
            of_plant, _ = plant.communicate(timeout=PATIENCE_S)
            # the plant is at its end a tick before the controller, which waits for one more measurement
            controller.terminate()
            of_controller, _ = controller.communicate(timeout=PATIENCE_S)
        finally:
            for process in (plant, controller):
                process.kill()
            for relay in relays:
                relay.end()
        self.assertEqual(plant.returncode, 0, of_plant)
        self.assertEqual(bits(self.path / "run.csv")[:TICKS + 1], bits(self.path / "alone.csv"), of_controller)
        self.assertIn(f"\n{TICKS} periods, {TICKS} commands, ", of_plant)
        self.assertIn(" 0 missing answers, ", of_plant)
        again = int(re.search(r"(\d+) measurements sent again", of_plant)[1])
        answers = int(re.search(r"(\d+) answers sent again", of_controller)[1])
        # a third each way: half of the measurements need a second try, and half of those got only the answer lost
        self.assertGreater(again, TICKS // 4, of_plant)
        self.assertGreater(answers, TICKS // 8, of_controller)
        for relay in relays:
            self.assertGreater(relay.lost, TICKS // 8)
        print(f"{again} measurements and {answers} answers sent again; "
              f"{relays[0].lost} of {relays[0].seen} and {relays[1].lost} of {relays[1].seen} were lost")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
