#!/bin/sh
# mujoco_plant_test.sh PYTHON TYPES TILLER SOURCE: an imported arm is steered in lockstep against the same URDF in MuJoCo
# with a load that nobody names. Skipped (77) where PYTHON has no MuJoCo. TYPES holds the generated Python package.
set -eu
python=$1 types=$2 tiller=$3 source=$4
"$python" -c 'import lcm, mujoco, tomllib' 2>/dev/null || { echo "no MuJoCo here"; exit 77; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
arm=$folder/arm.urdf
# without dry friction: MuJoCo's is soft, and gives way where it should stick
sed 's/ friction="[0-9.]*"//' "$source/examples/from_urdf/my_arm.urdf" >"$arm"
"$tiller" import "$arm" -o "$folder" --unknown payload=1 >"$folder/import.txt"
PYTHONPATH=$types "$python" "$source/examples/mujoco_plant/plant.py" "$arm" "$folder/robot.toml" --seconds 4 \
  --payload 0.35 --frame tool >"$folder/plant.txt" &
plant_id=$!
"$tiller" run "$folder/robot.toml" --transport lcm --arm --lockstep --patience 20 --seconds 4 --quiet --log "$folder/run.csv" \
  >"$folder/run.txt" 2>&1 || { kill $plant_id 2>/dev/null; cat "$folder/run.txt" >&2; exit 1; }
wait $plant_id
cat "$folder/plant.txt" "$folder/run.txt"
# the plant's last word, and the interval of the load
awk '/largest distance/ { for (i = 1; i < NF; ++i) if ($i == "is") exit !($(i + 1) < 0.02) }' "$folder/plant.txt"
sed -n 's/.*mass_kg.*90 % in \[\([0-9.e-]*\), \([0-9.e-]*\)\].*/\1 \2/p' "$folder/run.txt" |
  awk '{ found = 1; bad = !(0.34 < $1 && $1 < $2 && $2 < 0.36) } END { exit !found || bad }'
