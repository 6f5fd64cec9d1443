"""lcm_foreign_test.py CLIENT TYPES: what another machine sends, on a network of two (a veth pair, a namespace each).

With ttl=0 its measurements are refused and counted, though they carry the right group, channel and type; a datagram
sent to this machine's own address does not arrive at all. With ttl=1 they are taken. This machine's own are taken in
both. Run in a network namespace of its own.
"""
import os
import socket
import struct
import subprocess
import sys
import time

CLIENT, TYPES = sys.argv[1:3]
sys.path.insert(0, TYPES)
from tiller_lcm import measurement_t  # noqa: E402

GROUP, PORT = "239.255.76.67", 7667
FOREIGN = 20
SENDER = """
import socket, sys, time
group = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
group.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
for line in sys.stdin:
    data = bytes.fromhex(line)
    group.sendto(data, ("%s", %d))
    group.sendto(data, ("10.9.0.1", %d))
""" % (GROUP, PORT, PORT)


def packet(sequence):
    message = measurement_t()
    message.stamp_us, message.sequence, message.count, message.valid_mask = 1000 + sequence, sequence, 2, 3
    return b"LC02" + struct.pack(">I", sequence) + b"TILLER_MEASUREMENT\0" + message.encode()


def run(*command):
    subprocess.run(command, check=True)


def start_other_machine():
    other = subprocess.Popen(["unshare", "-n", "sh", "-c", "echo up; exec cat >/dev/null"], stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE, text=True)
    assert other.stdout.readline() == "up\n"
    run("ip", "link", "add", "near", "type", "veth", "peer", "name", "far", "netns", str(other.pid))
    run("ip", "address", "add", "10.9.0.1/24", "dev", "near")
    run("ip", "link", "set", "near", "up")
    run("ip", "route", "replace", "224.0.0.0/4", "dev", "near")
    inside = ["nsenter", "-t", str(other.pid), "-n"]
    run(*inside, "ip", "address", "add", "10.9.0.2/24", "dev", "far")
    run(*inside, "ip", "link", "set", "far", "up")
    run(*inside, "ip", "route", "add", "224.0.0.0/4", "dev", "far")
    return other, inside


def facts_of_run(inside, ttl, count):
    client = subprocess.Popen([CLIENT, f"udpm://{GROUP}:{PORT}?ttl={ttl}", str(count)], stdout=subprocess.PIPE, text=True)
    assert client.stdout.readline() == "ready\n"
    lines = "".join(packet(sequence).hex() + "\n" for sequence in range(FOREIGN))
    subprocess.run([*inside, sys.executable, "-c", SENDER], input=lines, text=True, check=True, timeout=60)
    time.sleep(0.2)  # a veth pair delivers at once; what came would have been counted
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    own.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    until = time.monotonic() + 60
    sequence = 1000
    while client.poll() is None and time.monotonic() < until:
        own.sendto(packet(sequence), (GROUP, PORT))
        sequence += 1
        time.sleep(0.05)
    out, _ = client.communicate(timeout=60)
    assert client.returncode == 0, client.returncode
    return {key: int(value) for key, value in (part.split("=") for part in out.split())}


other, inside = start_other_machine()
try:
    facts = facts_of_run(inside, 0, 1)
    print("ttl=0:", facts)
    assert facts == {"received": 1, "bad": FOREIGN, "old": 0}, "each foreign one refused once, and the first own one taken"
    facts = facts_of_run(inside, 1, FOREIGN + 1)
    print("ttl=1:", facts)
    assert facts["received"] == FOREIGN + 1 and facts["bad"] == 0
finally:
    other.kill()
