# programs: bench_transports
"""./dev bench transports: a measurement to a controller and its command back, over LCM and over ROS 2's wire.

    ./dev bench transports [EXCHANGES [PAUSE_US]]    (10000, 1000)

Both run by turns between the same two processes on a loopback of their own. The other ends are liblcm's and Cyclone
DDS's, as plants have them.
"""

import os
import re
import sys

from _driver import ROOT

if {"-h", "--help"} & set(sys.argv):
    sys.exit(__doc__)
LOOPBACK = (ROOT / "tests/ros2/loopback.xml").read_text(encoding="utf-8")
PROGRAM = ROOT / "build/release/bench/bench_transports"
if not PROGRAM.exists():
    sys.exit(f"{PROGRAM} is not built: install cyclonedds-dev and cyclonedds-tools (./dev setup), and build again")
os.environ["CYCLONEDDS_URI"] = re.sub(r"\n *", "", LOOPBACK.strip())
IN_NAMESPACE = str(ROOT / "tests/io/in_network_namespace.sh")
os.execv(IN_NAMESPACE, [IN_NAMESPACE, str(PROGRAM), *sys.argv[1:]])
