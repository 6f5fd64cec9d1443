#!/bin/sh
# first_run.sh TILLER URDF [PYTHON [INCLUDE]]: imports, checks and runs an arm of which nothing is unknown, with nothing said
# but what has to be. At the end of 4 s every joint of the simulated plant is within 0.02 of where the robot file wants it.
# Then its record is replayed, its size told and its C compiled against the headers in INCLUDE.
set -eu
tiller=$1 urdf=$2 python=${3:-} include=${4:-}
rm -rf first
"$tiller" import "$urdf" -o first --hold grip,grip_mirror
"$tiller" check first/robot.toml
"$tiller" run first/robot.toml --sim --seconds 4 --quiet --log first/run.csv
awk -F, '
  FNR == NR && /^target = / {
    gsub(/target = \{|\}/, "")
    for (i = 1; i <= NF; ++i) { split($i, pair, "="); gsub(/[ "]/, "", pair[1]); target[pair[1]] = pair[2] + 0 }
  }
  FNR == NR { next }
  FNR == 1 { for (i = 1; i <= NF; ++i) column[$i] = i }
  { for (name in target) last[name] = $(column["true." name]) }
  END {
    for (name in target) {
      ++joints
      miss = last[name] - target[name]
      print name " ends " miss " from its target"
      if (last[name] == "" || miss > 0.02 || miss < -0.02) bad = 1
    }
    exit bad || joints == 0
  }' first/robot.toml first/run.csv

# A record of the run gives the same commands again; the robot file becomes C, and tells what it takes.
"$tiller" run first/robot.toml --sim --seconds 0.5 --quiet --record first/run.mcap
"$tiller" replay first/run.mcap | grep -q ' 0 different'
"$tiller" size first/robot.toml | grep -q 'tiller_tick'
"$tiller" export first/robot.toml -o first/arm.c
grep -q 'tiller_model()' first/arm.c
[ -z "$include" ] || cc -std=c99 -fsyntax-only -Wall -Wextra -Werror "-I$include" first/arm.c

[ -n "$python" ] || exit 0
# The page's figure is where the model says that its frame is; a cost too small to matter puts that into the log.
sed 's/^# \(frames\..*[{,] *\)weight = 1000\(.*\)rotation_weight = 100/\1weight = 1e-9\2rotation_weight = 1e-9/' \
  first/robot.toml > first/told.toml
frame=$(sed -n 's/^frames\.\([a-z_]*\) = .*/\1/p' first/told.toml)
"$tiller" run first/told.toml --sim --seconds 0.6 --quiet --report first/told.html
grep -q 'id=robot-canvas' first/told.html
"$python" "$(dirname "$0")/figure_check.py" first/told.csv "$frame"
