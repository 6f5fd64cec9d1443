"""make_seeds.py [--check] CORPUS TYPES: small inputs to begin with, one folder a fuzzer. Findings join them by hand.
With --check nothing is written: it fails where the corpus is not what this would write, as after a change of a message.

TYPES is the folder of the generated Python package tiller_lcm. Deterministic: running it again changes nothing. The
words of robot files come from docs/reference/robot_file.md.
"""
import hashlib
import json
import pathlib
import re
import struct
import sys
import zlib

CHECK = sys.argv[1] == "--check"
CORPUS, TYPES = sys.argv[1 + CHECK:3 + CHECK]
sys.path.insert(0, TYPES)
from tiller_lcm import arm_t, command_t, forces_t, goal_t, measurement_t, telemetry_t  # noqa: E402


def save(fuzzer, name, data):
    path = pathlib.Path(CORPUS, fuzzer, name)
    if CHECK:
        if not path.exists() or path.read_bytes() != data:
            sys.exit(f"{path} is not what make_seeds.py writes: run it without --check")
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


# ---- lcm: one byte of options, then packets with their length in two bytes

def measurement(sequence, count=3, mask=7, stamp_us=None):
    m = measurement_t()
    m.stamp_us, m.sequence, m.count, m.valid_mask = stamp_us or 1000 * sequence, sequence, count, mask
    m.value = [0.5, -1.0, float(sequence)] + [0.0] * 9
    return m.encode()


def packet(channel, message, magic=b"LC02"):
    data = magic + struct.pack(">I", 1) + channel + b"\0" + message
    return struct.pack(">H", len(data)) + data


def sign(message, counter):
    body = message + struct.pack(">Q", counter)
    key = bytes([1, 2, 3]) + bytes(29)
    return body + hashlib.blake2s(b"M\0" + body, digest_size=16, key=key).digest()


save("lcm", "two_measurements", b"\0" + packet(b"M", measurement(1)) + packet(b"M", measurement(2)))
save("lcm", "other_channel", b"\0" + packet(b"CAMERA", b"abc") + packet(b"M", measurement(3, 3, 5)))
save("lcm", "other_type", b"\0" + packet(b"M", command_t().encode()) + packet(b"M", measurement(3, 12, 7)))
save("lcm", "fragment", b"\0" + packet(b"", bytes(12) + b"M\0x", b"LC03"))
save("lcm", "signed", b"\1" + b"".join(packet(b"M", sign(measurement(i), 100 + i)) for i in (1, 2, 2)))
save("lcm", "url", b"\2" + b"239.255.76.67:7667?ttl=1&recv_buf_size=100000")
save("lcm", "seal", b"\3" + measurement(7))
save("lcm", "round_trip", b"\4\2" + struct.pack(">qIIddd", 1000, 7, 8000, 0.5, float("inf"), float("nan")))

# ---- abi: two configurations (planner and engine, how many settings to change and words to spoil, what these are),
# then steps: whose, the call, arguments

ARM, DISARM, STOP, RESET, GOAL, BOX, PREPARE, ITERATIONS, READ, TICK = range(1, 11)


def life(*calls):
    return b"".join(bytes([1, call, *arguments]) for call, *arguments in calls)


RUN = life((ARM,), *[(TICK, kind % 8) for kind in range(5, 35)])
for planner in range(9):
    save("abi", f"planner_{planner}", bytes([planner, 0, planner + 128, 0]) + RUN + life((READ, 0, 3, 128), (PREPARE,), (TICK, 5)))
save("abi", "transition", bytes([16, 0, 48, 0]) + RUN + life((STOP,), (TICK, 5), (RESET,), (ARM,), (TICK, 5), (TICK, 6)))
save("abi", "probed", bytes([64, 0, 64, 0]) + RUN + life((BOX, 96, 128, 80, 144, 80, 144, 30, 20), (TICK, 5), (TICK, 5)))
save("abi", "goals", bytes([1, 0, 0, 0]) + RUN + life((GOAL, 112, 112, 112, 112, 8), (TICK, 5), (GOAL, 120, 112, 112, 112, 14),
                                                     (TICK, 5), (ITERATIONS, 2), (TICK, 5), (DISARM,), (TICK, 5)))
save("abi", "sensors", bytes([0, 0, 0, 0]) + RUN + life((TICK, 3, 225, 14), (TICK, 3, 225, 12), (TICK, 4), (TICK + 96, 4), (TICK, 5)))
save("abi", "clock_set", bytes([0, 0, 0, 0]) + life((ARM,), *[(TICK, 5), (TICK, 11)] * 8) +
     life((TICK, 255, *struct.pack(">q", 500000)), *[(TICK, 4)] * 9))
save("abi", "layout", bytes([0, 64 - 16 + 1, 40, 3, 1, 8, 1, 200, 0, 56, 1, 8, 0, 7]) + life((0, 1), (0, 2), (0, 0)) + RUN)

# ---- can: two bytes for the layout, then steps: kind, then a frame (kind, identifier, length, data) or a command


def frame(node, command, data, kind=0):
    return b"\5" + bytes([kind, {1: 0, 2: 1, 48: 2, 63: 3}[node] << 5 | command, len(data)]) + data


def board(sequence):
    stamp = frame(48, 0, struct.pack("<II", 5000 * sequence, sequence))
    value = frame(48, 27, struct.pack("<iHBB", 123456, sequence, 1, 0))
    return stamp + value


encoder = frame(1, 9, struct.pack("<ff", 0.5, 1.0)) + frame(2, 9, struct.pack("<ff", -0.5, 2.0))
heartbeat = frame(1, 1, struct.pack("<IBBBB", 0, 8, 0, 0, 0))
command = b"\0\2" + struct.pack(">dd", 1.5, -2.5)
run = encoder + board(1) + command + heartbeat + encoder + board(2)
for layout in range(4):
    save("can", f"odrive_{layout}", bytes([layout, 0]) + run)
save("can", "odrive_fault", b"\0\0" + command + frame(1, 1, struct.pack("<IBBBB", 64, 1, 0, 0, 0)) + b"\1" + command)
# moteus answers with registers: mode, position, velocity, torque as floats, then voltage, temperature and fault as
# bytes
registers = b"\x2c\x04\x00" + struct.pack("<ffff", 10.0, 0.25, -0.5, 0.1) + b"\x23\x0d\x30\x18\x00"
answer = b"\5" + bytes([4 + 1, 1, len(registers)]) + registers
save("can", "moteus", b"\3\x11" + b"\2" + answer + command + answer + answer)
save("can", "moteus_int16", b"\3\x55" + command + b"\5" + bytes([5, 1, 9]) + b"\x24\x04\x00" + struct.pack("<hhh", 10, 99, -5))
question = b"\5" + bytes([15, 0]) + struct.pack(">I", 0x8100) + bytes([len(registers)]) + registers
save("can", "moteus_question", b"\3\x11" + command + question + answer)
# MIT: node, then 16 bits of position, 12 of velocity, 12 of torque
packed = bytes([1, 0x80, 0x10, 0x7F, 0xF8, 0x01])
save("can", "mit", b"\3\x22" + command + b"\5" + bytes([2, 17, 6]) + packed + b"\5" + bytes([2, 18, 6, 2]) + packed[1:] + command)
save("can", "mit_ak", b"\0\x66" + command + b"\5" + bytes([2, 17, 8]) + packed + b"\x30\0" + board(1))

tells_fault = b"\5" + bytes([2, 17, 8, 0xD1]) + packed[1:] + b"\x30\x31"  # node 1: lost its supervisor
save("can", "mit_damiao", b"\0\x88" + command + tells_fault + b"\1" + command)


def crc8(data):
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x2F if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def protected(data, counter):
    body = data + bytes([counter])
    whole = body + bytes([crc8(b"\x23\x01" + body)])
    return b"\1" + bytes([len(whole)]) + whole


save("can", "e2e", b"\x80\x0f" + b"".join(protected(b"abcdef", i % 256) for i in (254, 255, 0, 0, 1)))

# ---- links: a byte for the robot (drive, planner, where readings come from), then steps (fuzz_links.cpp)


def wire(step, message):
    return bytes([step, len(message)]) + message


def goal(sequence, kind, *value):
    g = goal_t()
    g.sequence, g.kind, g.count, g.value = sequence, kind, len(value), value
    return g.encode()


permit = b"\7\0\1"
alive, failed = b"\10\0\10", b"\10\1\1"
reading, estimates = [bytes([3, 64, 112 + i]) for i in range(12)], [bytes([1, 112 + i, 112]) for i in range(12)]
pulse, late = bytes([10]), bytes([250])
for name, robot, readings in (("over_lcm", 128, reading), ("kept_off", 64 + 128, reading), ("over_can", 0, estimates),
                              ("moteus", 129, reading), ("mit", 130, reading)):
    start = alive + readings[0] + pulse + permit
    motion = b"".join(one + alive + pulse for one in readings[1:9])
    save("links", name, bytes([robot]) + start + motion + failed + readings[9] + pulse + b"\x09\1" + readings[10] + pulse)
save("links", "steered", b"\x80" + alive + reading[0] + pulse + permit + reading[1] + pulse + wire(4, goal(1, 0, 1.0, 0.0)) +
     reading[2] + pulse + bytes([5, 3, 0, 120, 112]) + reading[3] + pulse + b"\7\0\0" + reading[4] + pulse + late)
a = arm_t()
a.answered_stamp_us, a.arm = 1020000, 1
save("links", "bytes", b"\x80" + reading[0] + pulse + wire(6, a.encode()) + wire(2, packet(b"M", measurement(1, 1, 1))[2:]) +
     b"\0" + bytes([0, 9, 8]) + struct.pack("<ff", 0.5, 1.0) + b"\x09\0\x09\2\x09\3" + pulse)

# ---- robot_parts: a robot file and the files that it names, a byte 0x1e between them

tree = pathlib.Path(__file__).resolve().parents[2]


def plain(path):
    return re.sub(r"\s*#.*", "", (tree / path).read_text()).strip() + "\n"


network, policy = re.findall(r"```json\n(.*?)```", (tree / "docs/reference/networks.md").read_text(), re.S)[:2]
pendulum = plain("robots/pendulum.toml").replace('kind = "cem"', 'kind = "policy"\nfallback = "ilqr"')
pendulum += '[[effects]]\nkind = "network"\n[network]\nfile = "@1"\n[policy]\nfile = "@2"\n'
save("robot_parts", "networks", "\x1e".join((pendulum, network, policy)).encode())
folder = "tests/tools/task"
task = plain(f"{folder}/task.toml").replace(', "shown_3.csv"', "")
names = ("task.posterior.json", "track.csv", "shown_1.csv", "shown_2.csv")
for i, name in enumerate(names):
    task = task.replace(name, f"@{i + 1}")
save("robot_parts", "task", "\x1e".join((task, *(plain(f"{folder}/{name}") for name in names))).encode())

# ---- logs for the pendulum: CSV, LCM

rows = "".join(f"{0.02 * i:.2f},{0.1 * i % 1:.4f},{0.05 * i:.4f},{(-1) ** i * 0.5}\n" for i in range(30))
save("csv", "plain", ("time_s,angle_rad,rate_rad_s,torque_Nm\n" + rows).encode())
save("csv", "quoted", ('# a comment\n"time_s" ; "angle_rad";"torque_Nm"\r\n' + "0,1,2\r\n" * 25).encode())
save("csv", "gaps", ("time_s,angle_rad,torque_Nm\n" + "".join(f"{i * i},nan,{i}\n" for i in range(25))).encode())
head = ("tick,now_us,calls,stop_status,iterations,status,state,torque_Nm,mean.angle_rad,mean.rate_rad_s,mean.mass_kg,sd.mass_kg,"
        "stamp_us,sequence,command_latency_us,infinite,angle_rad\n")
save("csv", "run", (head + "0,0,1,0,3,ok,ACTIVE,0.1,0,1e-300,0.5,0.1,1000,7,500,1,\n" +
                    "1,20000,0,0,0,sensor_stale,SAFE,-0,,2,0.5,0.1,,,,,\n").encode())
save("csv", "run_without_a_state", (head + "0,0,1,0,3,ok,NONE,0.1,0,1,0.5,0.1,,,,,\n").encode())


def event(number, channel, message):
    return struct.pack(">IQQII", 0xEDA1DA01, number, 1000000 + 20000 * number, len(channel), len(message)) + channel + message


def command_to(i, state=2):
    c = command_t()
    c.stamp_us, c.sequence, c.state, c.count, c.value = 1000 * i, i, state, 1, [0.5, 0.0, 0.0, 0.0]
    return c.encode()


def telemetry(i):
    t = telemetry_t()
    t.stamp_us, t.tick, t.state, t.state_count, t.param_count = 1000 * i, i + 1, 2, 2, 3
    return t.encode()


def forces(i):
    f = forces_t()
    f.stamp_us, f.tick, f.touched, f.count, f.mean, f.sd = 1000 * i, i + 1, 1, 1, [0.5], [0.1]
    return f.encode()


# A command that is lost is held over, so one is enough for twenty rows: short inputs are fast ones.
log = far = event(0, b"TILLER_MEASUREMENT", measurement(0, 1, 1)) + event(1, b"TILLER_COMMAND", command_to(0))
for i in range(1, 20):
    log += event(i + 1, b"TILLER_MEASUREMENT", measurement(i, 1, 1))
    far += event(i + 1, b"TILLER_MEASUREMENT", measurement(i, 1, 1, (-1) ** i * (2**63 - 1)))
run = b""
for i in range(3):
    run += event(3 * i, b"TILLER_MEASUREMENT", measurement(i, 1, 1)) + event(3 * i + 1, b"TILLER_COMMAND", command_to(i))
    run += event(3 * i + 2, b"TILLER_TELEMETRY", telemetry(i)) + event(3 * i + 3, b"TILLER_FORCES", forces(i))
save("log", "lcm", log)
save("log", "lcm_cut", log[:-17])
save("log", "stamps_far_apart", far)
save("log", "lcm_run", run)
save("log", "lcm_no_telemetry", event(0, b"CAMERA", bytes(40)) + log[:178] + b"waste" + log[178:600])
save("log", "record", b"REC\0")
save("log", "record_changed", b"REC\3" + bytes([0, 9, 1, 0, 200, 255, 16, 0, 255]) + b"\1\x20\0" + b"tail")

# ---- mcap: a file of one tick with everything in it, the same without the CRCs that keep damage from what is behind
# them, and a recipe (fuzz_mcap.cpp)


def text(words):
    return struct.pack("<I", len(words)) + words


def record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + content


def json_of(**fields):
    return json.dumps(fields, separators=(",", ":")).encode()


def tick(i):
    numbers = dict.fromkeys(("planner_iterations", "calls", "stop_status", "tick_ns", "plan_cost", "effective_samples",
                             "noise_scale"), 1)
    params = dict.fromkeys(("mass_kg", "length_m", "damping_Nms"), 0.5)
    return (json_of(stamp_us=1000 * i, sequence=i, command_latency_us=0, angle_rad=0.25),
            json_of(stamp_us=1000 * i, sequence=i, plan_sequence=i, torque_Nm="inf"),
            json_of(tick=i, now_us=1000 * i, state_code=2, status_code=0, has_measurement=1, **numbers,
                    mean={"angle_rad": None, "rate_rad_s": -1e-300, **params}, sd=params))


def mcap(crc):
    magic = b"\x89MCAP0\r\n"
    inside = b""
    for topic, schema in enumerate((b"tiller.Measurement", b"tiller.Command", b"tiller.Tick")):
        inside += record(3, struct.pack("<H", topic + 1) + text(schema) + text(b"jsonschema") + text(b"{}"))
        inside += record(4, struct.pack("<HH", topic, topic + 1) + text(b"/t") + text(b"json") + text(b""))
    for topic, message in enumerate(tick(0)):
        inside += record(5, struct.pack("<HIQQ", topic, 0, 0, 0) + message)
    chunk = struct.pack("<QQQI", 0, 0, len(inside), crc * zlib.crc32(inside)) + text(b"") + struct.pack("<Q", len(inside))
    attached = struct.pack("<QQ", 0, 0) + text(b"controller") + text(b"") + struct.pack("<Q", 8) + b"TILLREC2"
    attached += struct.pack("<I", crc * zlib.crc32(attached))
    return (magic + record(1, text(b"") + text(b"fuzz")) + record(12, text(b"tiller") + text(b"")) +
            record(6, chunk + inside) + record(9, attached) + record(15, bytes(4)) + record(2, bytes(20)) + magic)


save("mcap", "run", mcap(1))
save("mcap", "no_crc", mcap(0))
save("mcap", "recipe", b"RUN" + b"".join(struct.pack(">BH", topic, len(message)) + message
                                         for i in range(2) for topic, message in enumerate(tick(i))))

# ---- robot files: keys and values as words for libFuzzer's mutations, from the page that the schema writes

page = (pathlib.Path(__file__).resolve().parents[2] / "docs/reference/robot_file.md").read_text()
words = set(re.findall(r"^\| `([a-z_A-Z0-9]+)` \|", page, re.M)) | set(re.findall(r"`(\[\[?[a-z_.]+\]\]?)`", page))
for choices in re.findall(r"\| one of ([a-z0-9_, ]+) \|", page):
    words |= set(choices.split(", "))
words |= {" = ", "{ ", " }", "true", "inf", "nan", "1e308", "-1", "0x7fffffffffffffff", r'\"\"', "sensors.", "[[sim.effects]]"}
if not CHECK:  # a word less is no harm
    save("..", "robot_file.dict", "".join(f'"{word}"\n' for word in sorted(words)).encode())
