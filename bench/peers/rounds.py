"""A Python peer's part in the comparisons: see rounds.hpp."""

import json
import sys
import time


def cpu_per_call(call, least_s=0.05):
    calls = 1
    while True:
        begin = time.process_time()
        for _ in range(calls):
            call()
        spent = time.process_time() - begin
        if spent >= least_s:
            return spent / calls
        calls = int(1.2 * calls * least_s / spent) + 1 if spent > 0.1 * least_s else 8 * calls


def take_part(contenders):
    """contenders: name -> (measure() in seconds a call, facts)."""
    for line in sys.stdin:
        if line.startswith("check"):
            answer = {name: facts for name, (_, facts) in contenders.items()}
        else:
            answer = {name: measure() for name, (measure, _) in contenders.items()}
        print(json.dumps(answer), flush=True)
