"""lcm_interop_test.py CLIENT LCM_BIN TYPES: the runtime's own codec and unmodified LCM programs on one network.

1. lcm-logger records what CLIENT (the own codec) and a plant in Python (package lcm) say to each other; nothing is
lost.
2. lcm-logplayer plays the plant's side of that log to a fresh CLIENT, which takes every measurement.
3. With a key: a plant that signs by examples/python_plant/seal.py is heard, and takes CLIENT's commands; without a
   signature, with another key, changed on the way, repeated, from before CLIENT started, from an end that CLIENT does
   not know, or on another channel nothing passes.
Run in a network namespace of its own.
"""
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

CLIENT, LCM_BIN, TYPES = sys.argv[1:4]
sys.path.insert(0, TYPES)
sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "examples/python_plant"))
import lcm  # noqa: E402
from seal import Seal  # noqa: E402
from tiller_lcm import command_t, measurement_t  # noqa: E402

URL = "udpm://239.255.76.67:7667?ttl=0"
COUNT, BATCH = 200, 10  # lcm-logger loses messages when more than 30 wait for it, so it is given time to catch up
PATIENCE_S = 60  # only ever waited for in full by a test that fails


def measurement(sequence):
    message = measurement_t()
    message.stamp_us, message.sequence = 1000000 + 20000 * sequence, sequence
    message.count, message.valid_mask = 2, 3
    message.value = [0.5 * sequence, -1.0] + [0.0] * 10
    return message.encode()


children = []


def start(*command, **options):
    # a group of its own: the wheel's programs are scripts that start the real one
    children.append(subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, **options))
    return children[-1]


def start_client(*arguments):
    client = start(CLIENT, *arguments, stdout=subprocess.PIPE, text=True)
    assert client.stdout.readline().strip() == "ready"
    return client


def finish(client):
    out, _ = client.communicate(timeout=PATIENCE_S)
    assert client.returncode == 0, (client.returncode, out)
    return dict(part.split("=") for part in out.split())


def answered(bus, inbox, publish, sequence):
    """Publishes until the command of this sequence is there: either side may be slow, nothing may be lost."""
    until = time.monotonic() + PATIENCE_S
    publish()
    while time.monotonic() < until:
        if bus.handle_timeout(200) and any(command.sequence == sequence for command, _ in inbox):
            return True
    return False


def subscribe(bus):
    inbox = []
    bus.subscribe("TILLER_COMMAND", lambda _, data: inbox.append((command_t.decode(data), data)))
    return inbox


def wait_for_log(bus, log, count):
    until = time.monotonic() + PATIENCE_S
    while True:
        bus.publish("WARM_UP", b"x")  # lcm-logger flushes its file when it writes
        channels = [event.channel for event in lcm.EventLog(log, "r")]
        found = channels.count("TILLER_MEASUREMENT"), channels.count("TILLER_COMMAND")
        if found == (count, count):
            return
        assert time.monotonic() < until, found
        time.sleep(0.01)


def record(log):
    logger = start(os.path.join(LCM_BIN, "lcm-logger"), "-q", "--flush-interval=1", "-l", URL, log, stdout=subprocess.DEVNULL)
    bus = lcm.LCM(URL)
    inbox = subscribe(bus)
    until = time.monotonic() + PATIENCE_S
    while os.path.getsize(log) == 0 if os.path.exists(log) else True:  # the logger listens once something is written
        bus.publish("WARM_UP", b"x" * 3000)
        assert time.monotonic() < until, "lcm-logger does not start"
        time.sleep(0.05)
    client = start_client(URL, str(COUNT))
    for sequence in range(COUNT):
        assert answered(bus, inbox, lambda: bus.publish("TILLER_MEASUREMENT", measurement(sequence)), sequence), sequence
        if (sequence + 1) % BATCH == 0:
            wait_for_log(bus, log, sequence + 1)
    facts = finish(client)
    assert int(facts["received"]) == COUNT and int(facts["bad"]) == 0, facts
    assert [c.sequence for c, _ in inbox] == list(range(COUNT))
    assert all(c.value[0] == 0.25 * c.sequence and c.plan_sequence == c.sequence + 7 for c, _ in inbox)
    os.killpg(logger.pid, signal.SIGINT)
    print(f"lcm-logger: {COUNT} of {COUNT} measurements and commands")


def play(log, folder):
    only = os.path.join(folder, "plant.lcm")
    out = lcm.EventLog(only, "w", overwrite=True)
    for event in lcm.EventLog(log, "r"):
        if event.channel == "TILLER_MEASUREMENT":
            out.write_event(event.timestamp, event.channel, event.data)
    out.close()
    client = start_client(URL, str(COUNT))
    player = [os.path.join(LCM_BIN, "lcm-logplayer"), "-l", URL, "-s", "2", only]
    subprocess.run(player, check=True, timeout=PATIENCE_S, stdout=subprocess.DEVNULL)
    facts = finish(client)
    assert int(facts["received"]) == COUNT, facts
    print(f"lcm-logplayer: {facts['received']} of {COUNT} measurements")


CHANNEL = "TILLER_MEASUREMENT"


class SignedPlant:
    """Speaks and hears with a key; keeps all that it said."""

    def __init__(self, bus, key):
        self.bus, self.seal, self.inbox, self.said = bus, Seal(key), [], []
        self.subscription = bus.subscribe("TILLER_COMMAND", self.hear)

    def hear(self, channel, data):
        message = self.seal.open(channel, data)
        if message is not None:
            self.inbox.append((command_t.decode(message), data))

    def say(self, message):
        self.said.append(self.seal.sign(CHANNEL, message))
        self.bus.publish(CHANNEL, self.said[-1])

    def meet(self):
        """A message without content asks for the other end's challenge."""
        until = time.monotonic() + PATIENCE_S
        while not any(self.seal.answer):
            self.say(b"")
            self.bus.handle_timeout(200)
            assert time.monotonic() < until, "nobody challenges"

    def speak(self, count):
        for sequence in range(count):
            assert answered(self.bus, self.inbox, lambda: self.say(measurement(sequence)), sequence), sequence


def authenticate(folder):
    key = bytes(range(100, 132))
    path = os.path.join(folder, "robot.key")
    with open(path, "w") as file:
        file.write(key.hex() + "\n")
    os.chmod(path, 0o600)
    bus = lcm.LCM(URL)
    before = start_client(URL, "3", path)
    plant = SignedPlant(bus, key)
    plant.meet()
    plant.speak(3)
    finish(before)
    recording, taken = list(plant.said), len(plant.inbox)
    assert taken == 3, plant.inbox

    # another run of the receiver, and another of the plant
    client = start_client(URL, "3", path)
    bus.unsubscribe(plant.subscription)
    plant = SignedPlant(bus, key)
    for data in recording:
        bus.publish(CHANNEL, data)
    plant.meet()
    plant.speak(1)
    forged = [
        measurement(10),
        Seal(bytes(32)).sign(CHANNEL, measurement(11)),
        plant.seal.sign("TILLER_COMMAND", measurement(12)),
        plant.seal.sign("OTHER_MEASUREMENT", measurement(13)),
        measurement(16) + plant.seal.sign(CHANNEL, measurement(1))[-48:],
        plant.said[-1],
    ]
    stranger = Seal(key).sign(CHANNEL, measurement(14))
    for data in [*forged, stranger, *recording]:
        bus.publish(CHANNEL, data)
    for sequence in (1, 2):
        assert answered(bus, plant.inbox, lambda: plant.say(measurement(sequence)), sequence)
    facts = finish(client)
    assert int(facts["received"]) == 3 and int(facts["bad"]) == len(forged), facts
    # the recording twice, the stranger, and the new plant before it had heard the challenge
    assert int(facts["challenged"]) >= 2 * len(recording) + 2, facts
    assert [c.sequence for c, _ in plant.inbox] == [0, 1, 2]
    print(f"authentication: 3 signed measurements taken, {len(forged)} forgeries and {facts['challenged']} messages "
          f"without an answer refused, commands verify in Python")


try:
    with tempfile.TemporaryDirectory() as folder:
        log = os.path.join(folder, "run.lcm")
        record(log)
        play(log, folder)
        authenticate(folder)
finally:
    for child in children:
        try:
            os.killpg(child.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
