#!/bin/sh
# run_in_guest.sh --kernel FOLDER [--timeout S] [--memory MB] [--program PATH]... [--file HOST[:NAME]]... \
#   -- 'COMMAND LINE' ['COMMAND LINE'...]
#
# Boots a kernel with AF_CAN in an emulator and runs the command lines there, as root, one after the other, until one
# fails. Exits with its code.
#
#   --kernel FOLDER    as fetch_kernel.sh leaves it; fetched if it is not there
#   --program PATH     an executable; its shared libraries come along. On the guest's PATH under its own name
#   --file HOST:NAME   a file or folder for the working folder of the commands (default: under its own name)
#   --timeout S        for all of it (default 240); --memory MB of the guest (default 512)
#
# In the guest: vcan0, vcan1 and the pair vx0 <-> vx1 are up; ip, tc, candump, cansend, cangen, cangw and busybox
# are there; nothing else is, no network either. Two emulated CAN controllers (SJA1000) share a bus; once their driver
# is loaded (insmod /modules/sja1000.ko; insmod /modules/kvaser_pci.ko) they are can0 and can1. The guest is emulated
# without hardware help (machines of CI seldom have it): floating point is 20 to 35 times slower than outside, so tests
# there run in lockstep.
set -eu
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
# shellcheck source=tests/vcan/stage.sh
. "$here/stage.sh"
parse_arguments "$@"
[ -n "$kernel" ] || stage_die "--kernel FOLDER is missing"

need() { # PROGRAM PACKAGE
  command -v "$1" 2>/dev/null || ls /usr/sbin/"$1" /sbin/"$1" 2>/dev/null | head -n 1 | grep . ||
    stage_die "this kernel has no CAN, and the emulated one needs $1: apt-get install $2"
}
case $(uname -m) in
  x86_64) qemu=$(need qemu-system-x86_64 qemu-system-x86) machine="-cpu max" console=ttyS0 ;;
  aarch64) qemu=$(need qemu-system-aarch64 qemu-system-arm) machine="-M virt -cpu max" console=ttyAMA0 ;;
  *) stage_die "no emulated kernel for $(uname -m): run these tests on a kernel with CONFIG_CAN" ;;
esac
busybox=$(need busybox busybox-static)
need cpio cpio >/dev/null
need flock util-linux >/dev/null
tools=
for pair in ip:iproute2 tc:iproute2 chrt:util-linux candump:can-utils cansend:can-utils cangen:can-utils cangw:can-utils; do
  tools="$tools $(need "${pair%:*}" "${pair#*:}")"
done
"$here/fetch_kernel.sh" "$kernel"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=$work/root
mkdir -p "$root/bin" "$root/busybox" "$root/modules" "$root/proc" "$root/sys" "$root/dev" "$root/tmp" "$root/test"
stage_tests "$root/test"
cp "$busybox" "$root/busybox/busybox"
cp "$here/can_interfaces.sh" "$root/bin/"
cp "$kernel"/modules/*.ko "$root/modules/"

# A program's shared libraries go where its loader looks for them.
bring_libraries() {
  ldd "$1" 2>/dev/null | sed -n 's/^.* => \(\/[^ ]*\) .*$/\1/p; s/^[[:space:]]*\(\/[^ ]*\) (.*$/\1/p' |
    while IFS= read -r library; do
      [ -e "$root$library" ] && continue
      mkdir -p "$root$(dirname "$library")"
      cp -L "$library" "$root$library"
    done
}
for tool in $tools; do
  cp -L "$tool" "$root/bin/"
  bring_libraries "$tool"
done
printf '%s' "$programs" | while IFS= read -r program; do bring_libraries "$program"; done
# plug-ins and modules among the files have libraries of their own
find "$root/test" -name '*.so*' | while IFS= read -r module; do bring_libraries "$module"; done

# The shell is this machine's own: busybox's would prefer its built-in ip to the real one.
cp -L /bin/sh "$root/bin/sh"
bring_libraries /bin/sh

cat >"$root/init" <<'END'
#!/bin/sh
/busybox/busybox --install -s /busybox
export PATH=/test:/bin:/busybox HOME=/tmp
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
echo 1 >/proc/sys/kernel/printk # the kernel's own lines would mix with the tests'
for name in can-dev can can-raw can-bcm vcan vxcan can-gw sch_netem; do
  if [ -e /modules/$name.ko ]; then insmod /modules/$name.ko; fi
done
# An emulated processor that was held up leaves frames to this thread of the kernel, and tests ran before it.
for thread in $(pidof ksoftirqd/0); do chrt -f -p 50 "$thread"; done
code=1
if ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && sh /bin/can_interfaces.sh; then
  cd /test
  (. ./commands)
  code=$?
fi
echo
echo "VIRTUAL CAN: exit $code"
poweroff -f 2>/dev/null
END
chmod +x "$root/init"
(cd "$root" && find . | cpio -o -H newc --quiet) >"$work/initrd"

log=$work/console
echo "virtual CAN: guest with kernel $(cat "$kernel/version")"
# shellcheck disable=SC2086 # $machine is a list of words
timeout -k 5 "$limit_s" "$qemu" $machine -accel tcg -m "$memory_MB" -net none -nographic -no-reboot \
  -object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus \
  -kernel "$kernel/vmlinuz" -initrd "$work/initrd" -append "console=$console quiet panic=-1 no_timer_check" \
  </dev/null 2>"$work/errors" | sed -u 's/\r//g; s/\x1bc//g; s/\x1b\[[?0-9;]*[a-zA-Z]//g' | tee "$log" || true
code=$(sed -n 's/^VIRTUAL CAN: exit \([0-9][0-9]*\)$/\1/p' "$log" | tail -n 1)
if [ -z "$code" ]; then
  cat "$work/errors" >&2
  stage_die "the guest did not finish within $limit_s s or died; its last lines are above"
fi
exit "$code"
