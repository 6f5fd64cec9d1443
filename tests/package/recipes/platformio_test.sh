#!/bin/sh
# The PlatformIO library, compiled for a Cortex-M7 as its library.json says, swings a pendulum up on the emulated board,
# with the commands of this machine:
#   platformio_test.sh ROOT WORK JOBS
set -eu
for program in arm-none-eabi-g++ qemu-system-arm; do
  command -v $program >/dev/null 2>&1 || { echo "no $program: ./dev cross small installs it"; exit 77; }
done
root=$1
work=$2
board='-mcpu=cortex-m7 -mthumb -mfloat-abi=hard -mfpu=fpv5-d16 -ffunction-sections -fdata-sections
  -fno-threadsafe-statics -fno-use-cxa-atexit -Wno-psabi -Os -DNDEBUG'
python3 "$root/tools/packaging/recipes/platformio/pack.py" "$root" "$work/library" --no-c-models
# shellcheck disable=SC2086 # words on purpose
python3 "$root/tests/package/recipes/compile_library.py" "$work/library" "$work/objects" "$3" arm-none-eabi- $board
# shellcheck disable=SC2086
arm-none-eabi-g++ $board -std=gnu++17 -fno-exceptions -fno-rtti -ffp-contract=off -DTILLER_CORTEX_M_BLOCK=139264 \
  -I "$work/library/include" -I "$root/tests/cortex_m" -I "$root/tests/cross" \
  "$root/tests/cortex_m/main.cpp" "$root/tests/cortex_m/board.cpp" "$root/tests/cross/swing_up.cpp" \
  "$work/objects/libtiller.a" -nostartfiles -specs=nano.specs -Wl,--gc-sections -T "$root/tests/cortex_m/an500.ld" \
  -o "$work/image.elf"
arm-none-eabi-size "$work/image.elf"
qemu-system-arm -M mps2-an500 -nographic -monitor none -serial none -icount shift=7 \
  -semihosting-config enable=on,target=native,arg=tiller,arg=300 -kernel "$work/image.elf" >"$work/board.txt" 2>&1 ||
  { cat "$work/board.txt"; exit 1; } # main's exit code: upright in time, and the policy quick enough

# The same library on this machine gives the same commands, to the last bit.
python3 "$root/tests/package/recipes/compile_library.py" "$work/library" "$work/native" "$3" '' -O2 -DNDEBUG
g++ -std=gnu++17 -O2 -ffp-contract=off -I "$work/library/include" -I "$root/tests/cross" \
  "$root/tests/cross/commands.cpp" "$root/tests/cross/swing_up.cpp" "$work/native/libtiller.a" -o "$work/commands"
"$work/commands" 300 >"$work/native.txt" 2>&1
for name in board native; do
  grep -E '^(mppi|ilqr|policy) ticks 300 hash' "$work/$name.txt" >"$work/$name.hashes"
done
[ "$(wc -l <"$work/board.hashes")" -eq 3 ]
diff "$work/board.hashes" "$work/native.hashes"
cat "$work/board.hashes"
