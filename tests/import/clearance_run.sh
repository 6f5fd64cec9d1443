#!/bin/sh
# clearance_run.sh TILLER URDF: the arm on a column carries its hand from the front to the back. Straight on is through the
# column: without [cost.clearance] the hand goes there, with it every planner goes around and arrives. Distances are those
# of the simulated plant's joints, by the arm's own trigonometry.
set -eu
tiller=$1 urdf=$2
rm -rf column && mkdir column
"$tiller" import "$urdf" -o column --frame hand \
  --sphere column:0,0,0.05,0.1 --sphere column:0,0,0.2,0.1 --sphere column:0,0,0.32,0.08 \
  --sphere forearm:0.17,0,0,0.04 --sphere hand:0,0,0,0.05 > column/import.txt

# PLANNER NAME SED: the task, from in front to behind
task() {
  sed -e 's/^state = { }/state = { shoulder_rad = -0.6, elbow_rad = 1.9 }/' \
    -e 's/^target = .*/target = { yaw_rad = 0 }/' \
    -e 's/^state_weight = .*/state_weight = { yaw_rad_s = 0.1, shoulder_rad_s = 0.1, elbow_rad_s = 0.1 }/' \
    -e 's/^terminal_weight = .*/terminal_weight = { yaw_rad_s = 1, shoulder_rad_s = 1, elbow_rad_s = 1 }/' \
    -e 's/^# frames.hand = .*/frames.hand = { position_m = [-0.3, 0.15, 0.2], weight = 1000 }/' \
    -e "s/^kind = \"ilqr\"/kind = \"$1\"/" -e "$3" column/robot.toml > "column/$2.toml"
}
# NAME: the least distance of the surfaces, and how far the hand ends from its target, in mm
measure() {
  awk -F, '
    function apart(z, radius, x, y, h, r,   d) {
      d = sqrt(x * x + y * y + (h - z) ^ 2) - radius - r
      if (least == "" || d < least) least = d
    }
    function point(along) {
      reach = 0.35 * cos(s) + along * cos(s + e)
      x = reach * cos(yaw); y = reach * sin(yaw); h = 0.45 - 0.35 * sin(s) - along * sin(s + e)
    }
    function all(r) { apart(0.05, 0.1, x, y, h, r); apart(0.2, 0.1, x, y, h, r); apart(0.32, 0.08, x, y, h, r) }
    NR == 1 { for (i = 1; i <= NF; ++i) column[$i] = i; next }
    {
      yaw = $(column["true.yaw_rad"]); s = $(column["true.shoulder_rad"]); e = $(column["true.elbow_rad"])
      point(0.17); all(0.04)
      point(0.35); all(0.05)
    }
    END { printf "%.1f %.1f\n", 1000 * least, 1000 * sqrt((x + 0.3) ^ 2 + (y - 0.15) ^ 2 + (h - 0.2) ^ 2) }' "column/$1.csv"
}
# NAME LOW HIGH: runs, and holds the least distance to LOW..HIGH mm; the target is reached to 5 mm
run() {
  "$tiller" run "column/$1.toml" --sim --seconds 6 --quiet --log "column/$1.csv" > "column/$1.txt"
  set -- "$@" $(measure "$1")
  echo "$1: least distance $4 mm, ends $5 mm from its target"
  awk -v d="$4" -v low="$2" -v high="$3" -v off="$5" 'BEGIN { exit !(d > low && d < high && off < 5) }'
}
task ilqr through 's/^weight = 1e+05/weight = 0/'
run through -300 -50
# of 30 mm of margin the soft bound keeps most
for planner in ilqr sqp hybrid mppi; do
  task "$planner" "$planner" ''
  run "$planner" 15 100
done
# ten times the weight, a third of what is missing and less
task ilqr heavy 's/^weight = 1e+05/weight = 1e+06/'
run heavy 28 100

# a sphere that has moved is told, and the command that is told mends it; the robot file stays as it is
sed 's/at_m = \[0.17, 0, 0\]/at_m = [0.2, 0, 0]/' column/ilqr.toml > column/robot.toml
cp column/robot.toml column/before.toml
if "$tiller" check column/robot.toml > column/check.txt 2>&1; then
  echo "a model of other spheres was taken"
  exit 1
fi
grep -q 'column/robot.toml:[0-9]*: cost.clearance.spheres.* has no sphere forearm_1 on forearm at 0.2 0 0; write the model anew' \
  column/check.txt
"$tiller" import "$urdf" -o column --frame hand --model-only > column/import.txt
cmp column/before.toml column/robot.toml
grep -q '^// sphere forearm_1 on forearm at 0.2 0 0$' column/column_arm.hpp
