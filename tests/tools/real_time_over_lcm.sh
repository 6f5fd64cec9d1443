#!/bin/sh
# Plant and controller as two processes over LCM by the wall clock: the pole must end upright in every seed.
# Usage: real_time_over_lcm.sh TILLER ROBOT "SEEDS". Takes ten seconds a seed, and a machine that is not overloaded:
# it is labelled slow, because no gate may hang on the wall clock. Where the kernel says that processes waited for a
# processor, a seed that failed is tried again, three times in all; a run with such seeds is skipped (exit code 77).
set -eu
tiller=$1
robot=$2
seeds=$3

folder=$(mktemp -d)
plant=
trap '[ -z "$plant" ] || kill -KILL "$plant" 2>/dev/null || true; rm -rf "$folder"' EXIT
cp "$robot" "$folder/robot.toml"
cd "$folder"

column() { head -n 1 "$2" | tr , '\n' | grep -nx "$1" | cut -d: -f1; }
good=0
all=0
busy=0

# processes waited for a processor in more than a fifth of the last ten seconds
is_busy() {
  share=$(sed -n 's/^some avg10=\([0-9]*\).*/\1/p' /proc/pressure/cpu 2>/dev/null)
  [ "${share:-0}" -gt 20 ]
}

one_run() { # seed
  seed=$1
  "$tiller" sim robot.toml --serve lcm --seed "$seed" >plant.txt 2>&1 &
  plant=$!
  "$tiller" run robot.toml --transport lcm --arm --seed "$seed" --seconds 10 --wait 30 --quiet --log run.csv \
    >controller.txt 2>&1 || { echo "seed $seed: the controller ended with $?"; tail -n 5 controller.txt; }
  kill -INT "$plant" && wait "$plant" || true
  plant=
  # since when |angle| < 0.2 rad holds; tick times
  awk -F, -v angle="$(column mean.angle_rad run.csv)" -v seed="$seed" '
    NR == 1 { next }
    {
      turn = 6.283185307179586
      a = $angle - turn * int($angle / turn + ($angle < 0 ? -0.5 : 0.5))
      if (a > -0.2 && a < 0.2) { if (from == "") from = $1 } else from = ""
    }
    END {
      printf "seed %s: %s from %s s, %d ticks\n", seed, from != "" && from <= 6 ? "upright" : "NOT", from, NR - 1
      exit !(from != "" && from <= 6 && NR > 490)  # a run that went to SAFE is shorter
    }' run.csv
}

for seed in $seeds; do
  all=$((all + 1))
  for attempt in 1 2 3; do
    if one_run "$seed"; then
      good=$((good + 1))
      continue 2
    fi
    is_busy || continue 2
    echo "seed $seed: the machine was busy with other work"
  done
  busy=$((busy + 1))
done
echo "upright within 6 s and held to 10 s, real time over LCM: $good of $all"
[ "$((good + busy))" -eq "$all" ]
[ "$busy" -eq 0 ] || { echo "skipped: $busy seeds on a machine that was busy"; exit 77; }
