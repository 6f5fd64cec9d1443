#!/bin/sh
# What `tiller export` says of compiling and linking, done word for word: a built-in model, one in C, one in C with a
# cost, one in C++, each in a program of C that knows nothing of the C++ library.
# usage: export_test.sh PREFIX WORK_FOLDER SOURCE_FOLDER
set -eu
prefix=$1
work=$2
source=$3

fail() { echo "FAILED: $*" >&2; exit 1; }

# the head's commands, with this installation in the place of /opt/tiller
commands() { sed -n '/^ \*     PREFIX=/,/ -o main$/s/^ \*     //p' robot_config.c | sed "s|/opt/tiller|$prefix|"; }

export_to() { # folder robot_file
  folder=$work/$1
  mkdir -p "$folder"
  cp -r "$(dirname "$2")/." "$folder"
  cd "$folder"
  TILLER_CACHE=$work/cache "$prefix/bin/tiller" export "$(basename "$2")" -o robot_config.c --prefix robot
  # shellcheck disable=SC2046 # flags
  cc -std=c11 -Wall -Wextra -Werror -I"$prefix/include" -c "$source/tests/package/consumer/loop.c" -o main.o
  commands >build.sh
  [ -s build.sh ] || fail "$1: the head has no commands"
}

# How fast a kernel runs is not judged here: the compiler hears every word of the command and the head, and then -O1.
# What is compiled without that word are the copies of model_loader_test.
make_quick_compiler() {
  mkdir -p "$work/quick"
  printf '#!/bin/sh\nexec "%s" "$@" -O1\n' "$(command -v c++)" >"$work/quick/c++"
  chmod +x "$work/quick/c++"
  export TILLER_CXX="$work/quick/c++"
}

try() {
  export_to "$@"
  PATH="$work/quick:$PATH" sh -eux build.sh || fail "$1: the head's commands do not build"
  ./main || fail "$1 does not run"
  if ldd ./main | grep -q 'libstdc++'; then fail "$1 asks for the C++ library"; fi
}

rm -rf "$work"
make_quick_compiler
try built_in "$source/robots/pendulum.toml"
try c_model "$source/examples/damped_pendulum_c99/robot.toml"
try c_cost "$source/examples/own_cost_c99/robot.toml"
try cpp_model "$source/examples/dead_zone_pendulum/robot.toml"

# the same file under the command of this installation: its copy is the one that the export has compiled. It reads logs
# from elsewhere, so the run only has to end well
for command in check 'run --sim --seconds 2 --quiet'; do
  # shellcheck disable=SC2086 # words
  set -- $command
  verb=$1
  shift
  TILLER_CACHE=$work/cache "$prefix/bin/tiller" "$verb" robot.toml "$@" >"$verb.txt" 2>&1 || fail "$verb: $(cat "$verb.txt")"
done
grep -q dead_zone_Nm check.txt || fail "check does not tell of dead_zone_Nm"
if grep -q 'compiling model' check.txt run.txt; then fail "the kept copy does not serve"; fi

# without optimisation: it works, or a sentence says what to do
sed 's/ -O[0-9] / -O0 /' build.sh >unoptimised.sh
if sh -eu unoptimised.sh 2>errors.txt; then
  ./main 4 || fail "it does not run unoptimised"  # a hundred times slower: minutes, were it a second of ticks
else
  grep -q 'does not compile without optimisation: add -O3' errors.txt || fail "no remedy in: $(head -5 errors.txt)"
  [ "$(grep -c 'error:' errors.txt)" -le 5 ] || fail "the remedy is buried in $(wc -l <errors.txt) lines"
fi
for isa in 'avx2 -mavx2 -mfma' 'avx512 -mavx512f -mavx512cd -mavx512dq -mavx512bw -mavx512vl -mfma'; do
  set -- $isa
  name=$1
  shift
  [ "$(uname -m)" = x86_64 ] || continue
  if c++ -std=c++17 -O0 "-DTILLER_COMPILE_ISA=$name" "-DTILLER_COMPILE_ISA_$name=1" "$@" \
    "-I$prefix/include" "-I$prefix/include/tiller/runtime" -fsyntax-only ./*_model.cpp 2>errors.txt; then
    continue
  fi
  grep -q 'does not compile without optimisation: add -O3' errors.txt || fail "-O0 for $name: $(head -5 errors.txt)"
done

# the flags that the manual states are the build's
for isa in sse2 avx2 avx512; do
  stated=$(sed -n "s/^| \`$isa\` | \`\(.*\)\` |$/\1/p" "$source/docs/guide/own_model.md")
  built=$(sed -n "s/^set(TILLER_ISA_FLAGS_$isa \([^)]*\)[)]*$/\1/p" "$source/cmake/TillerTargets.cmake")
  [ "$stated" = "$built" ] || fail "docs/guide/own_model.md has '$stated' for $isa, cmake/TillerTargets.cmake '$built'"
done
echo passed
