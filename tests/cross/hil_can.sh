#!/bin/sh
# hil_can.sh TILLER ROBOT NATIVE TICKS "PROTOCOL..." FOREIGN...: hardware in the loop across architectures on a virtual
# CAN bus. The plant is a process of this machine (ODE, `tiller sim`) behind a drive of each protocol and a sensor
# board; the controller is built for another machine and runs under its emulator. To be run where there is a vcan0
# (tests/vcan/run_on_can.sh).
#
#   1. the NATIVE controller opens its socket itself
#   2. the FOREIGN one (its command line, emulator first) gets a socket that a native program has opened and set up,
#      because the emulator knows no options of CAN sockets
#
# Both must send the same: the hashes over the commands' bits are equal, and so are all frames of the controller that a
# third program, candump, sees on the bus. Both controllers come from reproducible builds of
# tests/cross/can_runtime.cpp.
set -eu
tiller=$1 robot=$2 native=$3 ticks=$4 protocols=$5
shift 5
period_ms=20 # the robot file's
work=$(mktemp -d)
pids=
cleanup() {
  # shellcheck disable=SC2086 # words on purpose
  [ -z "$pids" ] || kill $pids 2>/dev/null || true
  rm -rf "$work"
}
trap cleanup EXIT
fail() {
  echo "FAILED: $*"
  tail -n 20 "$work"/*.plant "$work"/*.said 2>/dev/null || true
  exit 1
}

# The kernel lists every filter of every socket.
listeners() { cat /proc/net/can/rcvlist_* | grep -c "^ *vcan0 " || true; }
wait_for_more_than() {
  tries=0
  until [ "$(listeners)" -gt "$1" ]; do
    tries=$((tries + 1))
    [ "$tries" -lt 600 ] || fail "$2 did not begin to listen"
    sleep 0.1
  done
}

# What the controller sends: set points, requests, status; not what the plant does. One line a frame, without times.
frames_of_controller() { sed -e 's/^([^)]*) vcan0 //' "$1" | grep -E "^($2)#"; }

# loop NAME PROTOCOL CONTROLLER...
loop() {
  name=$1 protocol=$2
  shift 2
  before=$(listeners)
  candump -L vcan0 >"$work/$name.dump" &
  dump=$!
  pids="$pids $dump"
  wait_for_more_than "$before" candump
  before=$(listeners)
  "$@" >"$work/$name" 2>"$work/$name.said" &
  controller=$!
  pids="$pids $controller"
  wait_for_more_than "$before" "the $name controller"
  # somebody listens, so that nothing need be repeated: an emulator's first tick takes seconds
  "$tiller" sim "$work/robot.toml" --serve can --lockstep --answer-timeout 60 --repeat 60 \
    --seconds "$((ticks * period_ms / 1000)).$(printf %03d $((ticks * period_ms % 1000)))" >"$work/$name.plant" 2>&1 &
  plant=$!
  pids="$pids $plant"
  wait "$controller" || fail "$protocol: the $name controller"
  wait "$plant" || fail "$protocol: the plant of the $name controller"
  sleep 0.2
  kill "$dump"
  wait "$dump" 2>/dev/null || true
  pids=
}

for protocol in $protocols; do
  cp "$robot" "$work/robot.toml"
  printf '\n[transport]\nkind = "socketcan"\ninterface = "vcan0"\nnodes = { torque_Nm = 3 }\n' >>"$work/robot.toml"
  printf 'actuator = "%s"\nwheel_radius_m = { torque_Nm = 1 }\n' "$protocol" >>"$work/robot.toml"
  case $protocol in # identifiers that the controller sends; the status to the board is 601
    odrive) ids='067|06B|06E|601' ;;
    moteus) ids='00008003|601' ;;
    mit) ids='003|601' ;;
    *) fail "unknown protocol $protocol" ;;
  esac
  rm -f "$work"/native* "$work"/foreign*
  loop native "$protocol" "$native" vcan0 "$protocol" "$ticks"
  loop foreign "$protocol" "$native" --hand-over vcan0 "$protocol" "$@" fd:3 "$protocol" "$ticks"
  cmp -s "$work/native" "$work/foreign" || fail "$protocol: other commands: $(cat "$work/native" "$work/foreign")"
  for name in native foreign; do frames_of_controller "$work/$name.dump" "$ids" >"$work/$name.frames"; done
  cmp "$work/native.frames" "$work/foreign.frames" || fail "$protocol: other frames on the bus"
  count=$(grep -c '^601#' "$work/native.frames")
  [ "$count" -eq "$ticks" ] || fail "$protocol: $count statuses instead of $ticks"
  echo "$protocol: $(cat "$work/foreign"); $(wc -l <"$work/foreign.frames") frames alike, $(cat "$work/foreign.said")"
done
