#!/bin/sh
# python_plant_test.sh PYTHON TYPES PLANT CLIENT: the example plant, started leaning, is balanced by a client in C++.
# TYPES is the folder that holds the generated Python package.
set -eu
python=$1 types=$2 plant=$3 client=$4
result=$(mktemp)
trap 'rm -f "$result"' EXIT
PYTHONPATH=$types "$python" "$plant" --angle_rad 0.2 --seconds 6 >"$result" &
plant_id=$!
"$client" 300 || { kill $plant_id 2>/dev/null; echo "the client failed" >&2; exit 1; }
wait $plant_id
cat "$result"
# its own last word, from the true state: upright and at rest near the middle
awk '{ exit !($2 == 5.98 && $4 < 0.1 && $4 > -0.1 && $6 < 0.02 && $6 > -0.02) }' "$result"
