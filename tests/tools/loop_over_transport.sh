#!/bin/sh
# The whole loop as two processes over a transport: plant (`tiller sim`) and controller (`tiller run`).
#   1. lockstep: the pole ends upright; over LCM and ROS 2 the commands are those of the run in one process, to the last bit
#   2. the plant is killed: SAFE within two sensor timeouts of simulated time, a zero command, a message
#   3. the controller is killed: the device's watchdog stops the motor
#   4. the controller is stopped, and goes on later: the watchdog stops the motor, nothing old moves it again
# Usage: loop_over_transport.sh TILLER ROBOT lcm|ros2|signed|can SEEDS (signed: over LCM, both ends with a key). Runs in an
# empty folder, under POSIX sh and busybox.
set -eu
tiller=$1
robot=$2
transport=$3
seeds=$4

# wall time that a tick may take before the plant goes on without it (part 3)
slowest_tick_s=0.5
[ "$transport" = can ] && slowest_tick_s=1

folder=$(mktemp -d)
plant=
controller=
cleanup() {
  for child in $plant $controller; do kill -KILL "$child" 2>/dev/null || true; done
  rm -rf "$folder"
}
trap cleanup EXIT
fail() {
  echo "FAILED: $*" >&2
  for output in plant.txt controller.txt; do
    echo "--- $output" >&2
    tail -n 15 "$folder/$output" >&2 || true
  done
  exit 1
}

if [ "$transport" = can ]; then
  # an emulated guest computes five hundred times slower: fewer rollouts and particles swing the pole up as well
  sed -e 's/^kind = "lcm"$/kind = "socketcan"\ninterface = "vcan0"/' -e 's/^rollouts = .*/rollouts = 64/' \
    -e 's/^particles = 8$/particles = 4/' -e 's/^horizon = .*/horizon = 40/' -e 's/^iterations = .*/iterations = 1/' \
    -e 's/^particles = 256$/particles = 32/' -e 's/^window = .*/window = 32/' \
    -e 's/^moves_per_tick = .*/moves_per_tick = 8/' "$robot" >"$folder/robot.toml"
elif [ "$transport" = signed ]; then
  transport=lcm
  sed 's/^kind = "lcm"$/kind = "lcm"\nkey_file = "robot.key"/' "$robot" >"$folder/robot.toml"
  grep -q key_file "$folder/robot.toml" || fail "the robot file has no line kind = \"lcm\""
  (umask 077 && head -c 32 /dev/urandom | od -An -v -tx1 | tr -d ' \n' >"$folder/robot.key")
else
  cp "$robot" "$folder/robot.toml"
fi
cd "$folder"

# the plant goes on without an answer after this much wall time; nothing here waits for it but part 3
start_plant() { # seed
  "$tiller" sim robot.toml --serve "$transport" --lockstep --seed "$1" --answer-timeout "${2:-20}" >plant.txt 2>&1 &
  plant=$!
}
stop_plant() {
  kill -INT "$plant" && wait "$plant" || fail "the plant did not end well"
  plant=
}

# By what the controller has logged, not by time: a second of the run has passed.
wait_for_rows() {
  until [ -f run.csv ] && [ "$(wc -l <run.csv)" -ge 50 ]; do
    kill -0 "$controller" 2>/dev/null || fail "the controller ended early"
    sleep 0.1
  done
}

wait_for_watchdog() {
  tries=0
  until grep -q "WATCHDOG" plant.txt; do
    tries=$((tries + 1))
    [ "$tries" -lt 600 ] || fail "the watchdog did not stop the motor within a minute"
    sleep 0.1
  done
}

# column NAME FILE: its number in the header
column() { head -n 1 "$2" | tr , '\n' | grep -nx "$1" | cut -d: -f1; }

echo "1. lockstep over $transport"
for seed in $seeds; do
  start_plant "$seed"
  "$tiller" run robot.toml --transport "$transport" --arm --lockstep --seed "$seed" --seconds 5 --wait 60 \
    --patience 60 --quiet --log run.csv >controller.txt 2>&1 || fail "seed $seed: the controller ended with $?"
  stop_plant
  tail -n 1 run.csv | awk -F, -v angle="$(column mean.angle_rad run.csv)" '{
    turn = 6.283185307179586
    a = $angle - turn * int($angle / turn + ($angle < 0 ? -0.5 : 0.5))
    printf "   seed '"$seed"': %.4f rad from upright after %.2f s\n", a, $1
    exit !(a > -0.2 && a < 0.2)
  }' || fail "seed $seed: not upright"
  [ "$transport" != can ] || continue # CAN carries f32 torques and whole micro-units
  "$tiller" run robot.toml --sim --seed "$seed" --seconds 5 --quiet --log alone.csv >controller.txt 2>&1 ||
    fail "seed $seed: the run in one process ended with $?"
  for log in run alone; do cut -d, -f1-4 $log.csv >$log.bits; done
  cmp run.bits alone.bits || fail "seed $seed: other commands than in one process"
  echo "   seed $seed: the same commands as in one process"
done

echo "2. the plant is killed"
rm -f run.csv
start_plant 1
"$tiller" run robot.toml --transport "$transport" --arm --lockstep --seed 1 --wait 60 --log run.csv >controller.txt 2>&1 &
controller=$!
wait_for_rows
kill -KILL "$plant"
wait "$plant" 2>/dev/null || true
plant=
code=0
wait "$controller" || code=$?
controller=
[ "$code" -eq 3 ] || fail "the controller ended with $code, not with 3 (SAFE)"
grep -q "SAFE at .*sensor_stale" controller.txt || fail "no message"
awk -F, -v state="$(column state run.csv)" -v command="$(column force_N run.csv)" '
  NR == 1 { next }
  $2 != "" { measured = $1 }
  $state == "SAFE" && !safe { safe = $1; lag = safe - measured }
  $state == "SAFE" && $command != 0 { moving = 1 }
  END {
    printf "   SAFE %.3f s after the last measurement, command %s\n", lag, moving ? "not zero" : "zero"
    exit !(safe > 0 && lag <= 0.2 && !moving)
  }' run.csv || fail "SAFE too late, or with a command"

echo "3. the controller is killed"
rm -f run.csv
start_plant 1 "$slowest_tick_s"
"$tiller" run robot.toml --transport "$transport" --arm --lockstep --seed 1 --wait 60 --log run.csv >controller.txt 2>&1 &
controller=$!
wait_for_rows
kill -KILL "$controller"
wait "$controller" 2>/dev/null || true
controller=
wait_for_watchdog
stop_plant
grep "watchdog trips" plant.txt | sed 's/^/   /'

echo "4. the controller is stopped, and goes on"
rm -f run.csv
start_plant 1 "$slowest_tick_s"
"$tiller" run robot.toml --transport "$transport" --arm --lockstep --seed 1 --wait 60 --log run.csv >controller.txt 2>&1 &
controller=$!
wait_for_rows
kill -STOP "$controller"
wait_for_watchdog
kill -CONT "$controller"
# A drive on the bus has latched its watchdog's error. Over messages in lockstep simulated time goes on by messages, and all
# of them are there to be read: the controller may catch up; the plant takes no answer but the newest.
[ "$transport" = can ] || {
  sleep 2
  kill -INT "$controller" 2>/dev/null || true
}
code=0
wait "$controller" || code=$?
controller=
[ "$code" -eq 3 ] || { [ "$transport" != can ] && [ "$code" -eq 0 ]; } || fail "the controller went on with $code"
grep "SAFE at" controller.txt | sed 's/^/   /' || true
stop_plant
grep "watchdog trips" plant.txt | sed 's/^/   /'
echo "passed"
