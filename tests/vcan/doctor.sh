#!/bin/sh
# doctor.sh TILLER: `tiller can doctor` on real interfaces of a kernel. Each ailment is brought about, must be found,
# and is mended by the very command that the doctor names; then it must be gone. can0 is a controller with the kernel's
# driver (sja1000) and emulated hardware: it has a bit rate, modes and a queue, and a load that can be measured, but
# never an error on its wires. vcan0 is a virtual interface.
set -eu
tiller=$1
found=0

fail() {
  echo "FAILED: $*"
  cat doctor.txt
  exit 1
}

# look CODE INTERFACE [OPTION...]: what the doctor says, into doctor.txt
look() {
  wanted=$1
  shift
  code=0
  "$tiller" can doctor --seconds 0.1 "$@" >doctor.txt 2>&1 || code=$?
  [ "$code" -eq "$wanted" ] || fail "doctor $* ended with $code, not with $wanted"
}

# remedy TEXT: the command behind the finding, as a user would type it; root needs no sudo, nor the hint behind it
remedy() { grep -A 1 "$1" doctor.txt | sed -n 's/^ *-> //p' | sed -e 's/sudo //g' -e 's/ (.*)$//'; }

# mends CODE TEXT INTERFACE [OPTION...]: TEXT is found, the doctor ends with CODE, and its remedy helps
mends() {
  code_now=$1 text=$2
  shift 2
  look "$code_now" "$@"
  grep -q "^\(FAIL\|WARN\|note\)  .*$text" doctor.txt || fail "'$text' was not found"
  command=$(remedy "$text")
  [ -n "$command" ] || fail "no remedy for '$text'"
  sh -ec "$command" || fail "the remedy for '$text' does not work: $command"
  code_now=0
  "$tiller" can doctor --seconds 0.1 "$@" >doctor.txt 2>&1 || true
  ! grep -q "$text" doctor.txt || fail "'$text' is still there after: $command"
  found=$((found + 1))
  echo "mended: $text -> $command"
}

controller() { ip link set can0 down && ip link set can0 up type can "$@"; }

# ---- what is no bus ----
look 1 can7
grep -q 'is there such an interface.*ip link add can7 type vcan' doctor.txt || fail "a missing interface has no remedy"
look 1 lo
grep -q 'FAIL  lo is not a CAN interface' doctor.txt || fail "lo passes for a bus"
found=$((found + 2))

# ---- a controller ----
look 1 can0
grep -q 'FAIL  no bit rate is set' doctor.txt || fail "no bit rate, and nothing said"
mends 1 'it is down' can0
ip link set can0 txqueuelen 64
look 0 can0
! grep -q '^\(FAIL\|WARN\)' doctor.txt || fail "a healthy controller, and yet"
grep -q '^ok    bit rate 500000, sample point 0.875' doctor.txt || fail "the bit rate is not told"
grep -q '^ok    restarts 100 ms after bus-off' doctor.txt || fail "restart-ms is not told"
ip link set can0 down
mends 1 'it is down' can0
controller bitrate 500000 restart-ms 0
mends 0 'restart-ms 0' can0
controller bitrate 500000 sample-point 0.6
mends 0 'most nodes sample at 0.8 to 0.875' can0
controller listen-only on
mends 1 'it only listens' can0
controller loopback on
mends 1 'do not leave the controller' can0
controller one-shot on
mends 0 'one-shot' can0
controller presume-ack on
mends 0 'presume-ack' can0
ip link set can0 txqueuelen 4
mends 0 'send queue of 4 frames' can0
ip link set can0 txqueuelen 1000
mends 0 'send queue of 1000 frames' can0
look 1 can0 --fd
grep -q 'FAIL  it carries no CAN FD' doctor.txt || fail "no FD, and nothing said"
found=$((found + 1))
tc qdisc add dev can0 root netem delay 1ms
mends 0 'netem' can0

# ---- load: the emulated wire is quick, the bit rate says how much of a real one would be in use ----
controller bitrate 10000
ip link set can1 up type can bitrate 10000
look 0 can0
grep -q '^ok    the bus is in use 0 %' doctor.txt || fail "a bus at rest"
cangen can0 -g 4 -I 123 -L 8 -D 1122334455667788 &
flood=$!
sleep 0.5
code=0
"$tiller" can doctor --seconds 2 can0 >doctor.txt 2>&1 || code=$?
kill "$flood"
[ "$code" -eq 1 ] && grep -q 'FAIL  the bus is in use .*low priorities hardly get through' doctor.txt ||
  fail "a flooded bus"
grep 'the bus is in use' doctor.txt
found=$((found + 1))

# ---- who listens ----
pids=
for i in 1 2 3; do
  candump can0 >/dev/null &
  pids="$pids $!"
done
sleep 0.5
look 0 can0
grep -q 'note  .*3 listeners to everything.*each of these is given every frame' doctor.txt || fail "three listeners"
# shellcheck disable=SC2086 # words on purpose
kill $pids
found=$((found + 1))

# ---- virtual ----
ip link set vcan0 down
mends 1 'it is down' vcan0
ip link set vcan0 mtu 16 2>/dev/null || { ip link set vcan0 down; ip link set vcan0 mtu 16 up; }
mends 1 'it carries no CAN FD' vcan0 --fd
look 0 vcan0 --fd --json
grep -q '"worst": "good"' doctor.txt || fail "JSON of a healthy interface"

# ---- what ip printed here, read from a file, is judged alike ----
controller listen-only on restart-ms 0
ip -details -statistics -json link show dev can0 >link.json
look 1 --from link.json
cp doctor.txt from_file.txt
look 1 can0
grep -v 'filters,\|the bus is in use' doctor.txt | cmp - from_file.txt || fail "another judgement from a file"
echo "$found findings, each provoked"
