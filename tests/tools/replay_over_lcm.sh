#!/bin/sh
# Replay with LCM: hardware in the loop, and logs of lcm-logger.
#   1. a log of a simulated run takes the robot's place; a controller in another process answers with the same bits
#   2. one that is another controller (seed) is told from it, with an exit code
#   3. nobody answers: told
#   4. with a key both ways: the same bits; another key, or none, on the other side: told
#   5. what lcm-logger heard of a lockstep run replays to the last bit; so it does of a run by the wall clock, where
#      stamps, latencies and missed measurements are whatever the machine made of them
#   6. the CSV that `tiller run --log` wrote of those runs replays too
# Usage: replay_over_lcm.sh TILLER ROBOT LCM_LOGGER PYTHON. Runs in a network namespace with multicast on lo.
set -eu
tiller=$1
robot=$2
logger=$3
python=$4

folder=$(mktemp -d)
children=
cleanup() {
  for child in $children; do kill -s KILL -- "-$child" 2>/dev/null || kill -KILL "$child" 2>/dev/null || true; done
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

controller() { # ROBOT [OPTIONS]: waits for measurements, in a process of its own
  "$tiller" run "$@" --transport lcm --arm --lockstep --wait 60 --patience 60 --quiet --alarm-seconds 0 \
    >controller.txt 2>&1 &
  children=$!
}
end_controller() {
  kill -INT "$children" && wait "$children" || true
  children=
}
# fails_with CODE ROBOT PATIENCE: the replay is told from a good one
fails_with() {
  code=0
  "$tiller" replay run.mcap "$2" --through lcm --patience "$3" >replay.txt 2>&1 || code=$?
  [ "$code" -eq "$1" ] || fail "$2: the replay ended with $code, not $1"
}
same_bits() { # ROBOT
  "$tiller" replay run.mcap "$1" --through lcm --patience 30 >replay.txt 2>&1 || fail "$1: the replay ended with $?"
  grep -q "^100 ticks replayed on LCM, 0 different" replay.txt || fail "$1: other commands"
  sed 's/^/   /' replay.txt
}

echo "1. the log in the robot's place"
"$tiller" run robot.toml --sim --seconds 2 --quiet --record run.mcap >run.txt 2>&1 || fail "the run to be replayed"
controller robot.toml
same_bits robot.toml
end_controller

echo "2. another controller"
controller robot.toml --seed 9
fails_with 4 robot.toml 30
grep -q "^first difference in tick 0, at 0.000000 s: recorded ACTIVE, replayed ACTIVE" replay.txt || fail "no first difference"
grep "command  " replay.txt | sed 's/^/   /'
end_controller

echo "3. nobody answers"
fails_with 1 robot.toml 0.3
grep -q "nobody answers on udpm" replay.txt || fail "not told"

echo "4. with a key"
new_key() { (umask 077 && head -c 32 /dev/urandom | od -An -v -tx1 | tr -d ' \n' >"$1"); }
new_key robot.key
new_key other.key
sed 's/^kind = "lcm"$/kind = "lcm"\nkey_file = "robot.key"/' robot.toml >signed.toml
sed 's/robot\.key/other.key/' signed.toml >other.toml
grep -q 'key_file = "other.key"' other.toml || fail "the robot file has no line kind = \"lcm\""
controller signed.toml
same_bits signed.toml
end_controller
# who has another key, or none, does not hear it
for deaf in other.toml robot.toml; do
  controller "$deaf"
  fails_with 1 signed.toml 3
  grep -q "nobody answers on udpm.* key_file included" replay.txt || fail "$deaf: not told"
  end_controller
done

# mark LOG WORD: says a word on the bus until the log has it, so that everything said before is in the log too
mark() {
  tries=0
  until grep -q "$2" "$1" 2>/dev/null; do
    "$python" -c 'import lcm, sys; lcm.LCM().publish(sys.argv[1], b"")' "$2"
    tries=$((tries + 1))
    [ "$tries" -lt 100 ] || fail "lcm-logger does not log"
    sleep 0.1
  done
}

# logged NAME PLANT_OPTIONS RUN_OPTIONS: a run over LCM with a logger beside it
logged() {
  # a group of its own: what the Python package installs is a script that starts the logger
  setsid "$logger" --quiet --force "$1" >logger.txt 2>&1 &
  logging=$!
  children=$logging
  mark "$1" BEGIN
  # shellcheck disable=SC2086 # options are words on purpose
  "$tiller" sim robot.toml --serve lcm $2 >plant.txt 2>&1 &
  plant=$!
  children="$logging $plant"
  # shellcheck disable=SC2086
  code=0
  "$tiller" run robot.toml --transport lcm --arm --seconds 2 --wait 60 --quiet --alarm-seconds 0 --log "${1%.lcm}.csv" $3 \
    >controller.txt 2>&1 || code=$?
  # by the wall clock, a machine that is busy elsewhere may let the sensors grow stale: SAFE, and as good a log
  [ "$code" -eq 0 ] || { [ "$code" -eq 3 ] && [ -z "$3" ]; } || fail "$1: the run ended with $code"
  kill -INT "$plant" && wait "$plant" || fail "$1: the plant"
  mark "$1" END
  kill -s TERM -- "-$logging" && wait "$logging" || true
  children=
}

echo "5. logs of lcm-logger"
# replayed NAME PLANT_OPTIONS RUN_OPTIONS: the log of such a run, replayed. A logger that the machine starves loses
# messages, and the replay says so: then once more, and up to the first hole the commands are the same all the same.
replayed() {
  for attempt in 1 2 3 4; do
    [ "$attempt" -lt 4 ] || fail "$1: the logger lost messages three times"
    logged "$1" "$2" "$3"
    code=0
    "$tiller" replay "$1" robot.toml >replay.txt 2>&1 || code=$?
    grep -q "^[0-9]* ticks replayed on .*, 0 different" replay.txt || fail "$1: other commands, $code"
    [ "$code" -eq 2 ] || break
    grep -qE "missing: .*equal bits are promised" replay.txt || fail "$1: not told what is missing"
    sed 's/^/   once more: /' replay.txt
  done
  [ "$code" -eq 0 ] || fail "the replay of $1 ended with $code"
  sed "s/^/   $1: /" replay.txt
}
# at the pace of the wall clock: a listener's socket holds a second of that, even if it gets no turn meanwhile
replayed lockstep.lcm "--lockstep --pace 1 --answer-timeout 60" "--lockstep --patience 60"
grep -q "^100 ticks" replay.txt || fail "not all ticks in lockstep"
replayed clock.lcm "" ""
echo "6. CSV logs of the same runs"
for run in lockstep clock; do
  "$tiller" replay "$run.csv" robot.toml >replay.txt 2>&1 || fail "the replay of $run.csv ended with $?"
  grep -qE "^[1-9][0-9]+ ticks replayed on .*, 0 different" replay.txt || fail "$run.csv: other commands"
  sed "s/^/   $run: /" replay.txt
done
echo "passed"
