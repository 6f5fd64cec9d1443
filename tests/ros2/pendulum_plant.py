"""A pendulum with equations of its own, in lockstep over LCM or ROS 2's wire; every command that acted is written down.

    pendulum_plant.py --over lcm|ros2 --ticks N --commands FILE
"""
import argparse
import math
import sys
import time

PERIOD_US, STEP_S = 20000, 0.001
MASS_KG, LENGTH_M, DAMPING_NMS, G_M_S2 = 0.45, 0.5, 0.05, 9.81


def step(angle, rate, torque):
    inertia = MASS_KG * LENGTH_M**2
    rate += STEP_S * (torque - DAMPING_NMS * rate - MASS_KG * G_M_S2 * LENGTH_M * math.sin(angle)) / inertia
    return angle + STEP_S * rate, rate


def period(angle, rate, torque):
    for _ in range(round(PERIOD_US * 1e-6 / STEP_S)):
        angle, rate = step(angle, rate, torque)
    return angle, rate


class OverLcm:
    def __init__(self):
        import lcm
        from tiller_lcm import command_t, measurement_t
        self.measurement_t, self.command_t = measurement_t, command_t
        self.bus, self.inbox = lcm.LCM("udpm://239.255.76.67:7667?ttl=0"), []
        self.bus.subscribe("TILLER_COMMAND", lambda channel, data: self.inbox.append(data))

    def publish(self, k, angle):
        m = self.measurement_t()
        m.sequence, m.stamp_us, m.count, m.valid_mask, m.value[0] = k, 10**6 + k * PERIOD_US, 1, 1, angle
        self.bus.publish("TILLER_MEASUREMENT", m.encode())

    def answer(self, k, timeout_s):
        while self.bus.handle_timeout(int(1000 * timeout_s)):
            while self.inbox:
                command = self.command_t.decode(self.inbox.pop(0))
                if command.sequence == k:
                    return command.value[0]
        return None


class OverRos2:
    def __init__(self):
        from cyclonedds.core import ReadCondition, SampleState, ViewState, InstanceState, WaitSet
        from cyclonedds.util import duration
        import ros2_types as ros2
        self.ros2, self.duration = ros2, duration
        self.node = ros2.Node()
        self.writer = self.node.writer("joint_states", ros2.JointState)
        self.reader = self.node.reader("pendulum/commands", ros2.Float64MultiArray)
        self.waits = WaitSet(self.node.participant)
        self.waits.attach(ReadCondition(self.reader, SampleState.Any | ViewState.Any | InstanceState.Any))

    def publish(self, k, angle):
        message = self.ros2.JointState(self.ros2.stamp(10**9 + k * PERIOD_US * 1000), ["angle"], [angle])
        self.writer.write(message)

    def answer(self, k, timeout_s):
        until = time.monotonic() + timeout_s
        while (left_s := until - time.monotonic()) > 0:
            self.waits.wait(self.duration(seconds=left_s))
            for command in self.reader.take(N=16):
                if not isinstance(command, self.ros2.Float64MultiArray):
                    continue  # the writer is gone
                if command.sample_info.source_timestamp == 10**9 + k * PERIOD_US * 1000:
                    return command.data[0]
        return None


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--over", choices=("lcm", "ros2"), required=True)
    options.add_argument("--ticks", type=int, required=True)
    options.add_argument("--commands", required=True)
    options = options.parse_args()
    link = OverLcm() if options.over == "lcm" else OverRos2()
    angle, rate, repeats, lost = 0.3, 0.0, 0, 0
    with open(options.commands, "w", encoding="ascii") as out:
        for k in range(options.ticks + 2):  # the controller waits for one more than it needs
            torque = None
            while torque is None and (k < options.ticks or repeats < 10):
                link.publish(k, angle)
                # before the first answer the controller may not be there yet
                torque = link.answer(k, 0.1 if k == 0 or k >= options.ticks or options.over == "lcm" else 20)
                repeats += torque is None and k > 0
                lost += torque is None and 0 < k < options.ticks
            if torque is None:
                break
            out.write(torque.hex() + "\n")
            angle, rate = period(angle, rate, torque)
    print(f"{options.over}: {options.ticks} ticks, {lost} measurements sent again, angle {angle:.6f} rad")
    return int(options.over == "ros2" and lost > 0)


if __name__ == "__main__":
    sys.exit(main())
