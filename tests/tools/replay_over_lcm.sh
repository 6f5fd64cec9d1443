#!/bin/sh
# Replay with LCM: hardware in the loop, and logs of lcm-logger.
#   1. a log of a simulated run takes the robot's place; a controller in another process answers with the same bits
#   2. one that is another controller (seed) is told from it, with an exit code
#   3. nobody answers: told
#   4. what lcm-logger heard of a lockstep run replays to the last bit; so it does of a run by the wall clock, where
#      stamps, latencies and missed measurements are whatever the machine made of them
# Usage: replay_over_lcm.sh TILLER ROBOT LCM_LOGGER. Runs in a network namespace with multicast on lo.
set -eu
tiller=$1
robot=$2
logger=$3

folder=$(mktemp -d)
children=
cleanup() {
  for child in $children; do kill -KILL "$child" 2>/dev/null || true; done
  rm -rf "$folder"
}
trap cleanup EXIT
fail() {
  echo "FAILED: $*" >&2
  for output in *.txt; do
    echo "--- $output" >&2
    tail -n 15 "$output" >&2 || true
  done
  exit 1
}
cp "$robot" "$folder/robot.toml"
cd "$folder"

echo "1. the log in the robot's place"
"$tiller" run robot.toml --sim --seconds 2 --quiet --record run.mcap >run.txt 2>&1 || fail "the run to be replayed"
"$tiller" run robot.toml --transport lcm --lockstep --wait 60 --quiet --alarm-seconds 0 >controller.txt 2>&1 &
children=$!
"$tiller" replay run.mcap robot.toml --through lcm --patience 30 >replay.txt 2>&1 || fail "the replay ended with $?"
grep -q "^100 ticks replayed on LCM, 0 different" replay.txt || fail "other commands"
sed 's/^/   /' replay.txt
kill -INT "$children" && wait "$children" || true

echo "2. another controller"
"$tiller" run robot.toml --transport lcm --lockstep --wait 60 --quiet --seed 9 --alarm-seconds 0 >controller.txt 2>&1 &
children=$!
code=0
"$tiller" replay run.mcap robot.toml --through lcm --patience 30 >replay.txt 2>&1 || code=$?
[ "$code" -eq 4 ] || fail "the replay ended with $code, not 4"
grep -q "^first difference in tick 0, at 0.000000 s: recorded ACTIVE, replayed ACTIVE" replay.txt || fail "no first difference"
grep "command  " replay.txt | sed 's/^/   /'
kill -INT "$children" && wait "$children" || true
children=

echo "3. nobody answers"
code=0
"$tiller" replay run.mcap robot.toml --through lcm --patience 0.3 >replay.txt 2>&1 || code=$?
[ "$code" -eq 1 ] || fail "the replay ended with $code, not 1"
grep -q "nobody answers on udpm" replay.txt || fail "not told"

# logged NAME PLANT_OPTIONS RUN_OPTIONS: a run over LCM with a logger beside it
logged() {
  "$logger" --quiet --force "$1" >logger.txt 2>&1 &
  logging=$!
  # shellcheck disable=SC2086 # options are words on purpose
  "$tiller" sim robot.toml --serve lcm $2 >plant.txt 2>&1 &
  plant=$!
  children="$logging $plant"
  # shellcheck disable=SC2086
  "$tiller" run robot.toml --transport lcm --seconds 2 --wait 60 --quiet --alarm-seconds 0 $3 >controller.txt 2>&1 ||
    fail "$1: the run ended with $?"
  kill -INT "$plant" && wait "$plant" || fail "$1: the plant"
  sleep 0.2 # the logger's queue
  kill -INT "$logging" && wait "$logging" || true
  children=
}

echo "4. logs of lcm-logger"
logged lockstep.lcm "--lockstep --answer-timeout 20" --lockstep
"$tiller" replay lockstep.lcm robot.toml >replay.txt 2>&1 || fail "the replay of the lockstep log ended with $?"
grep -q "^10[0-9] ticks replayed on .*, 0 different" replay.txt || fail "other commands than in lockstep"
sed 's/^/   lockstep: /' replay.txt
logged clock.lcm "" ""
"$tiller" replay clock.lcm robot.toml >replay.txt 2>&1 || fail "the replay of the log by the wall clock ended with $?"
grep -q " ticks replayed on .*, 0 different" replay.txt || fail "other commands than by the wall clock"
sed 's/^/   by the wall clock: /' replay.txt
echo "passed"
