#!/bin/sh
# same_bits.sh TICKS BUILD...: runs the closed loop of swing_up.hpp in every build folder, under the emulator that its
# target needs, and fails where one prints other commands than the first.
set -eu
ticks=$1
shift

# lines_of BUILD: what its program prints
lines_of() {
  if [ -e "$1/tests/cortex_m/tiller_cortex_m" ]; then # the emulator prints what the image says on stderr
    qemu-system-arm -M mps2-an500 -nographic -monitor none -serial none -icount shift=7 \
      -semihosting-config "enable=on,target=native,arg=tiller,arg=$ticks" \
      -kernel "$1/tests/cortex_m/tiller_cortex_m" 2>&1 </dev/null
    return
  fi
  emulator=
  case $(sed -n 's/^CMAKE_TOOLCHAIN_FILE[^=]*=//p' "$1/CMakeCache.txt") in
    */aarch64.cmake) emulator='qemu-aarch64 -L /usr/aarch64-linux-gnu' ;;
    */armhf.cmake) emulator='qemu-arm -L /usr/arm-linux-gnueabihf' ;;
  esac
  # shellcheck disable=SC2086 # words on purpose
  $emulator "$1/tests/cross/tiller_commands" "$ticks" 2>/dev/null
}

expected=
failed=0
for build in "$@"; do
  printed=$(lines_of "$build") || { echo "$build: failed"; printf '%s\n' "$printed"; failed=1; continue; }
  commands=$(printf '%s\n' "$printed" | grep -v '^#')
  printf '%s\n%s\n' "$build" "$printed" | sed '2,$s/^/  /'
  if [ -z "$expected" ]; then
    expected=$commands
  elif [ "$commands" != "$expected" ]; then
    echo "$build: other commands than the first"
    failed=1
  fi
done
[ "$failed" -eq 0 ] && echo "the same bits over $ticks ticks in $# builds"
exit "$failed"
