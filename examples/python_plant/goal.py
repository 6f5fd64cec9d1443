"""Tells a running `tiller run ROBOT --goals lcm` where to bring its outputs: goal.py 0.6 0.1. docs/guide/lcm.md."""
import argparse
import time
import lcm
from tiller_lcm import goal_t

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("value", type=float, nargs="+", help="every output (or state) of the model, nan: stays as it is")
options.add_argument("--states", action="store_true", help="the values are states")
options.add_argument("--url", default="udpm://239.255.76.67:7667?ttl=0")
options.add_argument("--prefix", default="TILLER_")
options = options.parse_args()
goal = goal_t()
goal.stamp_us = time.time_ns() // 1000
goal.sequence = time.time_ns() // 10**6 % 2**32  # newer than that of the call before
goal.kind, goal.count, goal.value = 0 if options.states else 1, len(options.value), options.value
lcm.LCM(options.url).publish(options.prefix + "GOAL", goal.encode())
