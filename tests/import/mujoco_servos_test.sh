#!/bin/sh
# mujoco_servos_test.sh PYTHON TYPES TILLER SOURCE: an arm whose drives have laws, imported with --servos, is steered in
# lockstep against the same file in MuJoCo, whose own actuators take the goals. Skipped (77) where PYTHON has no MuJoCo.
set -eu
python=$1 types=$2 tiller=$3 source=$4
"$python" -c 'import lcm, mujoco, tomllib' 2>/dev/null || { echo "no MuJoCo here"; exit 77; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
TILLER_PYTHON=$python "$tiller" import "$source/tests/import/servos.xml" -o "$folder" --servos >"$folder/import.txt"

# steer NAME OPTION...: the largest distance from the target after two seconds
steer() {
  name=$1
  shift
  PYTHONPATH=$types "$python" "$source/examples/mujoco_plant/plant.py" "$source/tests/import/servos.xml" \
    "$folder/robot.toml" --seconds 2 "$@" >"$folder/$name.txt" &
  plant_id=$!
  "$tiller" run "$folder/robot.toml" --transport lcm --arm --lockstep --patience 20 --seconds 2 --quiet \
    >"$folder/run.txt" 2>&1 || { kill $plant_id 2>/dev/null; cat "$folder/run.txt" >&2; exit 1; }
  wait $plant_id
  sed -n 's/.*from the target is \([0-9.]*\).*/\1/p' "$folder/$name.txt"
}

# An encoder's noise is 0.00025 rad. Without --servos the plant takes goals for forces, and the arm falls.
with=$(steer servos --servos)
without=$(steer forces)
echo "from the target after 2 s: $with with --servos, $without without"
awk -v with="$with" -v without="$without" 'BEGIN { exit !(with < 0.01 && without > 0.1) }'
