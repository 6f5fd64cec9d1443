#!/bin/sh
# An engineer outside the tree: one model file and one robot file in an empty folder, every command works on them.
# usage: examples_test.sh TILLER EXAMPLES_FOLDER WORK_FOLDER CC INCLUDES...
set -eu
tiller=$1
examples=$2
work=$3
cc=$4
shift 4

rm -rf "$work"
mkdir -p "$work"
cp -r "$examples/damped_pendulum_c99" "$examples/own_model" "$examples/own_cost_c99" \
  "$examples/dead_zone_pendulum" "$examples/unicycle" "$work"
export TILLER_CACHE="$work/cache"
cd "$work"

# How fast a model's kernels run is not judged here: half of the compiler's work does. A copy that is compiled as the
# command does by itself is that of model_loader_test.
cxx=${TILLER_CXX:-c++}
printf '#!/bin/sh\nexec "%s" "$@" -O1\n' "$cxx" >quick_cxx
chmod +x quick_cxx
export TILLER_CXX="$work/quick_cxx"

fail() { echo "FAILED: $*" >&2; exit 1; }

# every command on one example; $2 is a state that its plant must show, $3 a parameter that it must learn, $4 the
# periods that 3 s have at least
try() {
  name=$1
  echo "== $name"
  "$tiller" check "$name/robot.toml" >"$name.check" || fail "check $name"
  grep -q 'is valid' "$name.check" || fail "check $name says nothing of valid"

  "$tiller" run "$name/robot.toml" --sim --seconds 3 --quiet --log "$name.csv" --record "$name.rec" >"$name.run" ||
    fail "run $name"
  cat "$name.run"
  head -n 1 "$name.csv" | grep -q "true.$2" || fail "$name.csv has no true.$2"
  [ "$(wc -l <"$name.csv")" -gt "$4" ] || fail "$name.csv is short"

  "$tiller" replay "$name.rec" "$name/robot.toml" >"$name.replay" || fail "replay $name: $(cat "$name.replay")"

  # the run's own log is data: what was learnt on the way is learnt again from the file
  "$tiller" identify "$name/robot.toml" "$name.csv" --particles 128 --window 64 --horizon 0.5 >"$name.identify" ||
    fail "identify $name"
  grep -q "$3" "$name.identify" || fail "identify $name does not tell of $3"

  "$tiller" export "$name/robot.toml" -o "${name}_config.c" --prefix robot || fail "export $name"
  includes=
  for folder in $includes_list; do includes="$includes -I$folder"; done
  # shellcheck disable=SC2086 # a list of words
  "$cc" -std=c99 -Wall -Wextra -Werror $includes -c "${name}_config.c" -o "${name}_config.o" ||
    fail "the exported configuration of $name is not C99"
}

includes_list=$*
try own_model position_m ball_mass_kg 145
try damped_pendulum_c99 angle_rad mass_kg 145
try own_cost_c99 angle_rad mass_kg 145
try unicycle heading_rad speed_gain 57
echo "== an effect at a joint that a kinematic model does not have is refused with a reason"
{
  cat unicycle/robot.toml
  printf '\n[[effects]]\nkind = "viscous_friction"\nport = "wheel"\ndamping_SI = 0.1\n'
} >unicycle/friction.toml
if "$tiller" check unicycle/friction.toml 2>refused.txt; then fail "friction without a joint passed"; fi
cat refused.txt
grep -q 'viscous_friction acts at a joint, and unicycle has none' refused.txt || fail "no reason"
grep -q 'effects of an input, a sensor or the body' refused.txt || fail "no remedy"
grep -q 'a cost of your own' own_cost_c99.check || fail "check own_cost_c99 does not tell of its cost"
grep -q 'config.cost.own = tiller_cost()' own_cost_c99_config.c || fail "the export lacks the cost"
[ "$(find "$TILLER_CACHE" -name '*.so' | wc -l)" -eq 4 ] || fail "each model is compiled once"

# dead_zone_pendulum reads logs from elsewhere, so its own log goes through other columns
"$tiller" check dead_zone_pendulum/robot.toml | grep -q dead_zone_Nm || fail "check dead_zone_pendulum"
"$tiller" run dead_zone_pendulum/robot.toml --sim --seconds 1 --quiet || fail "run dead_zone_pendulum"

echo "== a broken model is shown with file and line"
sed 's/x.rate_rad_s, (drive/x.rate_rad_s, (drvie/' dead_zone_pendulum/dead_zone_pendulum.hpp >broken.hpp
mv broken.hpp dead_zone_pendulum/dead_zone_pendulum.hpp
if "$tiller" check dead_zone_pendulum/robot.toml 2>broken.txt; then fail "a broken model passed"; fi
grep -q 'dead_zone_pendulum.hpp:[0-9]*:[0-9]*: error.*drvie' broken.txt || fail "no file and line: $(cat broken.txt)"
echo passed
