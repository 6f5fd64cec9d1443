#!/bin/sh
# drive_loops.sh TILLER ROBOT: `tiller run` steers the plant of `tiller sim` over a virtual CAN bus, in lockstep, behind
# a drive of each protocol in turn. The pendulum starts 0.05 rad from upright, where it falls in a second when it is
# left alone or steered wrongly; it must stand after two. ROBOT is robots/pendulum.toml, here with a planner and a
# posterior that an emulated machine computes in reasonable time.
set -eu
tiller=$1
robot=$2
work=$(mktemp -d)
plant=
cleanup() {
  [ -z "$plant" ] || kill -KILL "$plant" 2>/dev/null || true
  rm -rf "$work"
}
trap cleanup EXIT
fail() {
  echo "FAILED: $*"
  tail -n 20 "$work/plant.txt" "$work/controller.txt" || true
  exit 1
}

# robot_of PROTOCOL RANGE: its file; everything of the drive but its protocol and torque is as delivered
robot_of() {
  sed -e 's/^horizon = .*/horizon = 20/' -e 's/^knots = .*/knots = 5/' -e 's/^rollouts = .*/rollouts = 32/' \
    -e 's/^particles = .*/particles = 2/' -e 's/^iterations = .*/iterations = 1/' \
    -e 's/^\[start\]$/[start]\nstate = { angle_rad = 3.09 }/' \
    -e 's/^draw = true$/draw = true\nstate = { angle_rad = 3.09 }/' "$robot"
  printf '\n[posterior]\nparticles = 32\nwindow = 16\nmoves_per_tick = 8\n'
  printf '\n[transport]\nkind = "socketcan"\ninterface = "vcan0"\nnodes = { torque_Nm = 3 }\nactuator = "%s"\n' "$1"
  [ -z "$2" ] || printf 'drives.torque_Nm = { %s }\n' "$2"
}

# loop NAME PROTOCOL DRIVE
loop() {
  robot_of "$2" "$3" >"$work/robot.toml"
  "$tiller" sim "$work/robot.toml" --serve can --lockstep --seed 1 --seconds 2 --answer-timeout 20 \
    >"$work/plant.txt" 2>&1 &
  plant=$!
  "$tiller" run "$work/robot.toml" --transport can --arm --lockstep --seed 1 --seconds 2 --wait 60 --quiet \
    --log "$work/run.csv" >"$work/controller.txt" 2>&1 || fail "$1: the controller ended with $?"
  kill -INT "$plant" 2>/dev/null || true
  wait "$plant" || fail "$1: the plant did not end well"
  plant=
  head -n 1 "$work/run.csv" | tr , '\n' >"$work/columns"
  awk -F, -v angle="$(grep -nx mean.angle_rad "$work/columns" | cut -d: -f1)" \
    -v state="$(grep -nx state "$work/columns" | cut -d: -f1)" -v name="$1" '
    NR > 1 { off = $angle - 3.141592653589793; if ($state != "ACTIVE") ++others; ++ticks }
    END {
      printf "%s: %d ticks, %d of them not ACTIVE, %.3f rad from upright after %.2f s\n", name, ticks, others, off, $1
      exit !(ticks >= 95 && others <= 10 && off > -0.2 && off < 0.2)
    }' "$work/run.csv" || fail "$1: not upright"
}

loop odrive odrive ''
loop moteus moteus 'resolution = "int16"'
loop mit mit 'torque_Nm = 4, reply = "damiao"'
