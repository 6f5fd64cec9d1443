#!/bin/sh
# first_run.sh TILLER URDF: imports, checks and runs an arm of which nothing is unknown, with nothing said but what has to
# be. At the end of 4 s every joint of the simulated plant is within 0.02 of where the robot file wants it.
set -eu
tiller=$1 urdf=$2
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
