"""Arms a `tiller run` over LCM that stands by, or disarms it: arm.py [--disarm]. docs/guide/lcm.md."""
import argparse
import lcm
from tiller_lcm import arm_t, command_t

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--disarm", action="store_true")
options.add_argument("--url", default="udpm://239.255.76.67:7667?ttl=0")
options.add_argument("--prefix", default="TILLER_")
options = options.parse_args()
bus = lcm.LCM(options.url)


def answer(_, data):
    decision = arm_t()
    decision.answered_stamp_us = command_t.decode(data).stamp_us  # the sender has heard this run just now
    decision.arm = 0 if options.disarm else 1
    bus.publish(options.prefix + "ARM", decision.encode())


bus.subscribe(options.prefix + "COMMAND", answer)
if bus.handle_timeout(5000) == 0:
    raise SystemExit("no command within 5 s: is `tiller run` running, and is the prefix right?")
