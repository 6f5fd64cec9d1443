"""Frames of the codecs against encoders of others, byte by byte: ODrive by cantools from the DBC file, moteus by its
maker's Python library, the MIT protocol by the formulas of its manuals, written down here a second time.

Usage: actuator_reference.py PROGRAM DBC. Thousands of values of a fixed seed; exits with 1 at the first difference.
"""

import math
import random
import struct
import subprocess
import sys

import cantools
import moteus
from moteus import multiplex as mp

TURN = 2 * math.pi
RESOLUTIONS = {"int8": mp.INT8, "int16": mp.INT16, "int32": mp.INT32, "f32": mp.F32}


class Codec:
    """The program under test; lines are sent in one go and answered in order."""

    def __init__(self, program):
        self.program, self.lines, self.expected = program, [], []

    def settings(self, kind, node, mode="torque", resolution="f32", watchdog=0.1, reply="plain", reply_id=0,
                 ranges=(12.5, 50, 18, 500, 5), kp=0.0, kd=0.0):
        numbers = " ".join(repr(float(x)) for x in (*ranges, kp, kd))
        self.lines.append(f"settings {kind} {node} {mode} {resolution} {watchdog} {reply} {reply_id} {numbers}")

    def expect(self, line, check):
        self.lines.append(line)
        self.expected.append((line, check, self.lines[-2]))

    def run(self):
        done = subprocess.run([self.program], input="\n".join(self.lines) + "\n", text=True, capture_output=True)
        answers = done.stdout.splitlines()
        assert done.returncode == 0 and len(answers) == len(self.expected), done.stderr
        for (line, check, before), answer in zip(self.expected, answers):
            problem = check(answer)
            if problem:
                sys.exit(f"{before}\n{line}\n  made     {answer}\n  expected {problem}")
        return len(answers)


def frames(*wanted):
    text = " ".join(f"{id_:x} {int(extended)} {int(fd)} {data.hex()}" for id_, extended, fd, data in wanted)
    return lambda answer: None if answer == text else text


def taken(**wanted):
    names = ("alive", "has_mode", "enabled", "has_fault", "fault", "has_motion", "position", "velocity", "has_torque",
             "torque", "has_temperature", "temperature")

    def check(answer):
        words = answer.split()
        if words[0] != "taken":
            return f"taken {wanted}"
        values = dict(zip(names, map(float, words[1:])))
        for name, value in wanted.items():
            if not math.isclose(values[name], value, rel_tol=1e-12, abs_tol=1e-12):
                return f"{name} = {value}"
        return None

    return check


def values(rng, scale, count):
    """Everyday numbers, ends of the range and beyond, zeros."""
    some = [0.0, -0.0, scale, -scale, 1.5 * scale, -1.5 * scale, 1e-9]
    return some + [rng.uniform(-scale, scale) for _ in range(count)] + [rng.gauss(0, scale / 50) for _ in range(count)]


def f32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0]


# ---- ODrive ----


def odrive(codec, rng, dbc):
    database = cantools.database.load_file(dbc)
    encode = lambda name, **fields: database.get_message_by_name(name).encode(fields)
    for _ in range(20):
        node = rng.randrange(64)
        name = lambda command: (node << 5) | database.get_message_by_name(command).frame_id
        for mode, number in (("torque", 1), ("velocity", 2), ("position", 3)):
            codec.settings("odrive", node, mode)
            codec.expect("make enable", frames(
                (name("Set_Controller_Mode"), False, False, encode("Set_Controller_Mode", Control_Mode=number, Input_Mode=1)),
                (name("Set_Axis_State"), False, False, encode("Set_Axis_State", Axis_Requested_State=8))))
            for value in values(rng, 40, 40):
                message, fields = {
                    "torque": ("Set_Input_Torque", dict(Input_Torque=value)),
                    "velocity": ("Set_Input_Vel", dict(Input_Vel=value / TURN, Input_Torque_FF=0)),
                    "position": ("Set_Input_Pos", dict(Input_Pos=value / TURN, Vel_FF=0, Torque_FF=0)),
                }[mode]
                codec.expect(f"command {value!r}", frames((name(message), False, False, encode(message, **fields))))
        codec.settings("odrive", node)
        codec.expect("make disable", frames((name("Set_Axis_State"), False, False,
                                             encode("Set_Axis_State", Axis_Requested_State=1))))
        codec.expect("make clear", frames((name("Clear_Errors"), False, False, encode("Clear_Errors", Identify=0))))
        for _ in range(40):
            p, v, t = (f32(rng.gauss(0, s)) for s in (100, 20, 5))
            errors, state = rng.getrandbits(32) if rng.random() < 0.5 else 0, rng.choice([1, 8])

            def hear(message, check, **fields):
                codec.expect(f"receive {name(message):x} 0 0 {encode(message, **fields).hex()}", check)

            hear("Get_Encoder_Estimates", taken(has_motion=1, position=p * TURN, velocity=v * TURN),
                 Pos_Estimate=p, Vel_Estimate=v)
            hear("Heartbeat", taken(alive=1, enabled=state == 8, has_fault=1, fault=errors),
                 Axis_Error=errors, Axis_State=state, Procedure_Result=0, Trajectory_Done=0)
            hear("Get_Torques", taken(has_torque=1, torque=t), Torque_Target=0, Torque_Estimate=t)
            hear("Get_Temperature", taken(has_temperature=1, temperature=max(p, v)),
                 FET_Temperature=p, Motor_Temperature=v)


# ---- moteus ----


def padded(data):
    for length in (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64):
        if len(data) <= length:
            return data + bytes([mp.NOP]) * (length - len(data))
    raise ValueError("too long")


def moteus_codec(codec, rng):
    for _ in range(12):
        node = rng.randrange(1, 127)
        for word, code in RESOLUTIONS.items():
            query = moteus.QueryResolution()
            query.position = query.velocity = query.torque = code
            position = moteus.PositionResolution()
            for name in ("position", "velocity", "feedforward_torque", "kp_scale", "kd_scale", "watchdog_timeout",
                         "ilimit_scale"):
                setattr(position, name, code)
            controller = moteus.Controller(id=node, query_resolution=query, position_resolution=position,
                                           transport=object())
            id_ = 0x8000 | node
            watchdog = rng.choice([0.0, 0.05, 0.1, 1.0])

            def wanted(command):
                return frames((id_, True, True, padded(command.data)))

            for mode, scale in (("torque", 8), ("velocity", 60), ("position", 30)):
                codec.settings("moteus", node, mode, word, watchdog)
                gain = 0.0 if mode == "torque" else 1.0
                for value in values(rng, scale, 15):
                    codec.expect(f"command {value!r}", wanted(controller.make_position(
                        position=value / TURN if mode == "position" else math.nan,
                        velocity=value / TURN if mode == "velocity" else 0.0,
                        feedforward_torque=value if mode == "torque" else 0.0,
                        kp_scale=gain, kd_scale=gain, watchdog_timeout=watchdog, ilimit_scale=gain, query=True)))
            codec.expect("make disable", wanted(controller.make_stop(query=True)))
            codec.expect("make clear", wanted(controller.make_stop(query=True)))
            codec.expect("make query", wanted(controller.make_query()))
            for _ in range(25):
                moteus_answer(codec, rng, node, code)


def moteus_answer(codec, rng, node, code):
    """An answer as the firmware packs it: raw integers, or floats."""
    kind = struct.Struct("<" + "bhif"[code])
    steps = {mp.INT8: (0.01, 0.1, 0.5), mp.INT16: (1e-4, 0.00025, 0.01), mp.INT32: (1e-5, 1e-5, 1e-3),
             mp.F32: (1, 1, 1)}[code]
    most = mp.TYPES_MAX[code]
    raw = [f32(rng.gauss(0, 3)) if code == mp.F32 else rng.randrange(1 - most, most) for _ in range(3)]
    mode, fault, temperature = rng.choice([0, 10, 11, 1]), rng.choice([0, 33, 40, 99]), rng.randrange(-30, 120)
    data = bytes([0x21, 0x00, mode, 0x23 | code << 2, 0x01]) + b"".join(kind.pack(x) for x in raw)
    data += bytes([0x23, 0x0d, 48]) + struct.pack("<b", temperature) + bytes([fault])
    p, v, t = (x * s for x, s in zip(raw, steps))
    is_fault = mode in (1, 11)
    expected = dict(alive=1, has_mode=1, enabled=mode == 10, has_motion=1, position=p * TURN, velocity=v * TURN,
                    has_torque=1, torque=t, temperature=temperature)
    if mode == 1:
        expected["fault"] = fault or 255
    if not is_fault:
        expected["fault"] = 0
    reply_id = node << 8
    codec.expect(f"receive {reply_id:x} {int(reply_id > 0x7ff)} 1 {padded(data).hex()}", taken(**expected))


# ---- MIT ----


def to_code(value, low, high, bits):
    """The nearest code, the lower of two."""
    top = (1 << bits) - 1
    return max(0, math.ceil((min(max(value, low), high) - low) * top / (high - low) - 0.5))


def bits(*fields):
    """Fields of (value, bits) from the highest bit of the first byte on."""
    whole = total = 0
    for value, count in fields:
        whole, total = whole << count | value, total + count
    return whole.to_bytes(total // 8, "big")


def mit(codec, rng):
    for _ in range(12):
        node, reply_id = rng.randrange(1, 16), rng.choice([0, 0, 0x10, 0x7ff])
        reply = rng.choice(["plain", "ak", "damiao"])
        ranges = tuple(rng.choice(c) for c in ((12.5, 95.5), (30, 45, 65), (5, 18, 144), (500, 100), (5, 10)))
        p_max, v_max, t_max, kp_max, kd_max = ranges
        kp, kd = rng.uniform(0.1, kp_max), rng.uniform(0.1, kd_max)
        special = lambda code: frames((node, False, False, bytes([0xff] * 7 + [code])))
        for mode, scale in (("torque", t_max), ("velocity", v_max), ("position", p_max)):
            codec.settings("mit", node, mode, reply=reply, reply_id=reply_id, ranges=ranges, kp=kp, kd=kd)
            for value in values(rng, scale, 60):
                data = bits((to_code(value if mode == "position" else 0, -p_max, p_max, 16), 16),
                            (to_code(value if mode == "velocity" else 0, -v_max, v_max, 12), 12),
                            (to_code(kp if mode == "position" else 0, 0, kp_max, 12), 12),
                            (to_code(0 if mode == "torque" else kd, 0, kd_max, 12), 12),
                            (to_code(value if mode == "torque" else 0, -t_max, t_max, 12), 12))
                codec.expect(f"command {value!r}", frames((node, False, False, data)))
        for what, code in (("enable", 0xfc), ("disable", 0xfd), ("idle", 0xfd),
                           ("clear", 0xfb if reply == "damiao" else 0xfd)):
            codec.expect(f"make {what}", special(code))
        for _ in range(60):
            p, v, t = (rng.getrandbits(n) for n in (16, 12, 12))
            state, mos, rotor = rng.choice([0, 1, 8, 13]), rng.randrange(120), rng.randrange(120)
            number = lambda code, limit, n: code * 2 * limit / ((1 << n) - 1) - limit
            first = node | state << 4 if reply == "damiao" else node
            data = bits((first, 8), (p, 16), (v, 12), (t, 12))
            expected = dict(alive=1, has_motion=1, position=number(p, p_max, 16), velocity=number(v, v_max, 12),
                            has_torque=1, torque=number(t, t_max, 12))
            if reply == "ak":
                data += bytes([mos, rotor & 7])
                expected |= dict(has_temperature=1, temperature=mos, fault=rotor & 7)
            elif reply == "damiao":
                data += bytes([mos, rotor])
                expected |= dict(has_temperature=1, temperature=max(mos, rotor), enabled=state == 1,
                                 fault=state if state > 1 else 0)
            codec.expect(f"receive {reply_id:x} 0 0 {data.hex()}", taken(**expected))


def main():
    program, dbc = sys.argv[1:]
    codec, rng = Codec(program), random.Random(20260611)
    odrive(codec, rng, dbc)
    moteus_codec(codec, rng)
    mit(codec, rng)
    print(f"{codec.run()} frames alike")


if __name__ == "__main__":
    main()
