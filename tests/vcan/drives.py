"""Three drives on a bus, in Python: an ODrive (node 3; frames by cantools from the DBC file), a moteus (node 4; by its
maker's library) and one of the MIT protocol (node 5; by the formulas of its manuals), all through python-can. The other
side is drives_client.cpp, the runtime's transport. Both know what is said at every step, so every frame of the client
is compared byte by byte, in its order, and what the drives answer must arrive there with the values meant.

Usage: drives.py INTERFACE DBC STEPS. Runs VARIANTS one after the other; exits with 1 at the first frame that is not
what it should be.
"""

import io
import math
import sys

import can
import cantools
import moteus
from moteus import multiplex as mp
from moteus.protocol import Writer

TURN = 2 * math.pi
ODRIVE, MOTEUS, MIT = 3, 4, 5
P_MAX, V_MAX, T_MAX, KP_MAX, KD_MAX = 12.5, 50.0, 18.0, 500.0, 5.0
KP, KD = 20.0, 0.5
REQUESTS = 5  # to a drive whose reports do not prove that it took all of them: ODrive, MIT but for Damiao
# what is commanded, moteus' numbers, the MIT drive's dialect, and who reports a fault at the end
VARIANTS = [("torque", mp.INT16, "damiao", "mit"), ("velocity", mp.F32, "ak", "moteus"),
            ("position", mp.INT32, "plain", "odrive")]


def command(motor, step):
    """What the client commands to motor 0, 1, 2 at a step."""
    return (1.5 + motor) * math.sin(0.1 * step + motor)


def position(motor, step):
    """What the drives report."""
    return (0.5 + 0.25 * motor) * math.sin(0.05 * step + motor)


def velocity(motor, step):
    return (0.5 + 0.25 * motor) * math.cos(0.05 * step + motor)


def torque(motor, step):
    return 0.25 * command(motor, step)


class Odrive:
    def __init__(self, dbc, mode, fails):
        self.dbc, self.mode, self.fails = dbc, mode, fails
        self.state = 1

    def frame(self, name, **fields):
        message = self.dbc.get_message_by_name(name)
        return (ODRIVE << 5 | message.frame_id, False, False, message.encode(fields))

    def enables(self):
        number = {"torque": 1, "velocity": 2, "position": 3}[self.mode]
        return [self.frame("Set_Controller_Mode", Control_Mode=number, Input_Mode=1),
                self.frame("Set_Axis_State", Axis_Requested_State=8)]

    def commands(self, value):
        if self.mode == "torque":
            return [self.frame("Set_Input_Torque", Input_Torque=value)]
        if self.mode == "velocity":
            return [self.frame("Set_Input_Vel", Input_Vel=value / TURN, Input_Torque_FF=0)]
        return [self.frame("Set_Input_Pos", Input_Pos=value / TURN, Vel_FF=0, Torque_FF=0)]

    def stops(self):
        return [self.frame("Set_Axis_State", Axis_Requested_State=1), self.frame("Set_Input_Torque", Input_Torque=0)]

    def speaks(self, step, last):
        watchdog = 1 << 24
        return [self.frame("Heartbeat", Axis_Error=watchdog if self.fails and last else 0, Axis_State=self.state,
                           Procedure_Result=0, Trajectory_Done=0),
                self.frame("Get_Torques", Torque_Target=0, Torque_Estimate=torque(0, step)),
                self.frame("Get_Temperature", FET_Temperature=31.5, Motor_Temperature=40.25),
                self.frame("Get_Encoder_Estimates", Pos_Estimate=position(0, step) / TURN,
                           Vel_Estimate=velocity(0, step) / TURN)]


class Moteus:
    def __init__(self, mode, resolution, fails):
        self.mode, self.resolution, self.fails = mode, resolution, fails
        self.register = 0
        query, command_ = moteus.QueryResolution(), moteus.PositionResolution()
        query.position = query.velocity = query.torque = resolution
        for name in ("position", "velocity", "feedforward_torque", "kp_scale", "kd_scale", "watchdog_timeout",
                     "ilimit_scale"):
            setattr(command_, name, resolution)
        self.controller = moteus.Controller(id=MOTEUS, query_resolution=query, position_resolution=command_,
                                            transport=object())

    @staticmethod
    def padded(data):
        return data + bytes([mp.NOP]) * (next(n for n in (*range(9), 12, 16, 20, 24, 32, 48, 64) if n >= len(data)) -
                                         len(data))

    def frame(self, made):
        return (0x8000 | MOTEUS, True, True, self.padded(made.data))

    def queries(self):
        return [self.frame(self.controller.make_query())]

    def commands(self, value):
        gain = 0.0 if self.mode == "torque" else 1.0
        return [self.frame(self.controller.make_position(
            position=value / TURN if self.mode == "position" else math.nan,
            velocity=value / TURN if self.mode == "velocity" else 0.0,
            feedforward_torque=value if self.mode == "torque" else 0.0,
            kp_scale=gain, kd_scale=gain, ilimit_scale=gain, watchdog_timeout=0.1, query=True))]

    def stops(self):
        """Stopping would erase the code of a fault: such a drive is only asked."""
        return self.queries() if self.register == 1 else [self.frame(self.controller.make_stop(query=True))]

    def answers(self, step):
        buffer = io.BytesIO()
        writer = Writer(buffer)
        writer.write_int8(0x21)
        writer.write_int8(moteus.Register.MODE)
        writer.write_int(self.register, mp.INT8)
        writer.write_int8(0x23 | self.resolution << 2)
        writer.write_int8(moteus.Register.POSITION)
        writer.write_position(position(1, step) / TURN, self.resolution)
        writer.write_velocity(velocity(1, step) / TURN, self.resolution)
        writer.write_torque(torque(1, step), self.resolution)
        writer.write_int8(0x23)
        writer.write_int8(moteus.Register.VOLTAGE)
        writer.write_voltage(24, mp.INT8)
        writer.write_temperature(31, mp.INT8)
        writer.write_int(33 if self.register == 1 else 0, mp.INT8)
        return [(MOTEUS << 8, MOTEUS << 8 > 0x7ff, True, self.padded(buffer.getvalue()))]


def bits(*fields):
    """Fields of (value, bits) from the highest bit of the first byte on."""
    whole = total = 0
    for value, count in fields:
        whole, total = whole << count | value, total + count
    return whole.to_bytes(total // 8, "big")


def code(value, low, high, count):
    """The nearest code, the lower of two."""
    return max(0, math.ceil((min(max(value, low), high) - low) * ((1 << count) - 1) / (high - low) - 0.5))


class Mit:
    def __init__(self, mode, reply, fails):
        self.mode, self.reply, self.fails = mode, reply, fails
        self.entered = False

    def special(self, code_):
        return [(MIT, False, False, bytes([0xff] * 7 + [code_]))]

    def commands(self, value):
        p, v, t = (value if self.mode == name else 0 for name in ("position", "velocity", "torque"))
        kp, kd = KP if self.mode == "position" else 0, 0 if self.mode == "torque" else KD
        return [(MIT, False, False, bits((code(p, -P_MAX, P_MAX, 16), 16), (code(v, -V_MAX, V_MAX, 12), 12),
                                         (code(kp, 0, KP_MAX, 12), 12), (code(kd, 0, KD_MAX, 12), 12),
                                         (code(t, -T_MAX, T_MAX, 12), 12)))]

    def answers(self, step, last):
        """Where it will be when this is read: at the next step, once it is enabled."""
        at = step + self.entered
        data = bits((code(position(2, at), -P_MAX, P_MAX, 16), 16), (code(velocity(2, at), -V_MAX, V_MAX, 12), 12),
                    (code(torque(2, at), -T_MAX, T_MAX, 12), 12))
        state = 0xd if self.fails and last else int(self.entered)  # d: it has lost its host
        first = bytes([MIT | state << 4 if self.reply == "damiao" else MIT])
        rest = {"plain": b"", "ak": bytes([31, 0]), "damiao": bytes([30, 31])}[self.reply]
        return [(0, False, False, first + data + rest)]


class Session:
    """One variant from the first question to the last command."""

    def __init__(self, bus, dbc, steps, variant):
        mode, resolution, reply, fails = variant
        self.bus, self.steps, self.mode = bus, steps, mode
        self.odrive = Odrive(dbc, mode, fails == "odrive")
        self.moteus = Moteus(mode, resolution, fails == "moteus")
        self.mit = Mit(mode, reply, fails == "mit")
        self.step = self.compared = 0

    def send(self, frames):
        for id_, extended, fd, data in frames:
            self.bus.send(can.Message(arbitration_id=id_, data=data, is_extended_id=extended, is_fd=fd,
                                      bitrate_switch=fd))

    def expect(self, frames, nearly=False):
        """The next frames of the client are these. nearly: but for one step of a number in them."""
        for id_, extended, fd, data in frames:
            message = self.bus.recv(60)
            if message is None:
                sys.exit(f"step {self.step}: nothing for a minute instead of {id_:x} {data.hex()}")
            kind = (message.arbitration_id, message.is_extended_id, message.is_fd, message.bitrate_switch)
            came = bytes(message.data)
            close = nearly and abs(int.from_bytes(came, "little") - int.from_bytes(data, "little")).bit_count() == 1
            if kind != (id_, extended, fd, fd) or not (came == data or close):
                sys.exit(f"{self.mode}, step {self.step}: not {id_:x} {data.hex()}\n{message}")
            self.compared += 1

    def question(self):
        self.expect(self.moteus.queries())
        self.send(self.odrive.speaks(self.step, self.step > self.steps) + self.moteus.answers(self.step))
        if self.step == 0:  # the MIT drive is asked by the frame that keeps it off
            self.expect(self.mit.special(0xfd))
            self.send(self.mit.answers(0, False))

    def as_it_is(self, motor):
        """What it is told before it has confirmed: to go on as it does."""
        pushes = torque(motor, self.step) if self.step > 0 else 0
        return {"torque": pushes, "velocity": velocity(motor, self.step),
                "position": position(motor, self.step)}[self.mode]

    def commands(self):
        first, last = self.step == 0, self.step == self.steps
        blind = self.step < REQUESTS
        waits = [blind, first, first if self.mit.reply == "damiao" else blind]
        value = [self.as_it_is(motor) if waits[motor] else command(motor, self.step) for motor in range(3)]
        if waits[0]:
            self.expect(self.odrive.enables())
            self.odrive.state = 8
        self.expect(self.odrive.commands(value[0]), waits[0])
        self.expect(self.moteus.commands(value[1]), first)
        self.moteus.register = 1 if self.moteus.fails and last else 10
        self.send(self.moteus.answers(self.step))
        if waits[2]:
            self.expect(self.mit.special(0xfc))
            self.mit.entered = True
            self.send(self.mit.answers(self.step, False))
        self.expect(self.mit.commands(value[2]), waits[2])
        self.send(self.mit.answers(self.step, last))

    def safe(self):
        self.expect(self.odrive.stops() + self.moteus.stops() + self.mit.special(0xfd))

    def run(self):
        while self.step <= self.steps:
            self.question()
            self.commands()
            self.step += 1
        self.question()
        self.safe()
        return self.compared


def main():
    interface, dbc, steps = sys.argv[1:]
    database = cantools.database.load_file(dbc)
    heard = [{"can_id": id_, "can_mask": mask, "extended": extended}
             for id_, mask, extended in ((ODRIVE << 5, 0x7e0, False), (0x8000 | MOTEUS, 0x1fffffff, True),
                                         (MIT, 0x7ff, False))]
    with can.Bus(interface="socketcan", channel=interface, fd=True, can_filters=heard) as bus:
        for variant in VARIANTS:
            compared = Session(bus, database, int(steps), variant).run()
            print(f"drives.py: {variant[0]}: {compared} frames as they should be", flush=True)


if __name__ == "__main__":
    main()
