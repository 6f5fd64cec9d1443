#!/bin/sh
# fetch_kernel.sh FOLDER: puts a Linux kernel with CAN modules into FOLDER, for the tests on machines whose own
# kernel has no AF_CAN. Nothing is installed: the distribution's package is downloaded and unpacked.
#
#   FOLDER/vmlinuz, FOLDER/modules/*.ko   ready for run_in_guest.sh
#   FOLDER/wanted                         the modules that were looked for
#   FOLDER/version                        the kernel's release; written last, so its presence means complete
#
# Does nothing if FOLDER is complete. Safe to run from several tests at once.
set -eu

folder=${1:?usage: fetch_kernel.sh FOLDER}
# sja1000 and kvaser_pci: the driver of a controller that the emulator has
wanted="can-dev can can-raw can-bcm vcan vxcan can-gw sch_netem sja1000 kvaser_pci"
die() { printf 'fetch_kernel: %s\n' "$*" >&2; exit 1; }

mkdir -p "$folder"
folder=$(CDPATH='' cd -- "$folder" && pwd)
exec 9>"$folder/lock"
flock 9
[ -s "$folder/version" ] && [ "$(cat "$folder/wanted" 2>/dev/null)" = "$wanted" ] && exit 0

for tool in apt-get apt-cache dpkg-deb; do
  command -v $tool >/dev/null || die "no $tool here. Put a kernel there yourself: $folder/vmlinuz, the modules of" \
    "drivers/net/can and net/can in $folder/modules, and its release in $folder/version"
done

# The metapackage names the newest kernel. Debian keeps everything in linux-image-*, Ubuntu has the CAN modules
# in linux-modules-* and linux-modules-extra-*.
arch=$(dpkg --print-architecture)
dependency() {
  apt-cache depends "$1" 2>/dev/null | sed -n 's/^ *|\{0,1\}Depends: \(linux-image-[0-9].*\)$/\1/p' | head -n 1
}
image=
for meta in linux-image-$arch linux-image-cloud-$arch linux-image-generic linux-image-virtual; do
  image=$(dependency "$meta")
  [ -n "$image" ] && break
done
[ -n "$image" ] || die "apt knows no kernel package (linux-image-$arch, linux-image-generic). Run: apt-get update"
release=${image#linux-image-}
release=${release#unsigned-}
packages=$image
for extra in "linux-modules-$release" "linux-modules-extra-$release"; do
  apt-cache show "$extra" >/dev/null 2>&1 && packages="$packages $extra"
done

work=$folder/unpack
rm -rf "$work"
mkdir -p "$work/root"
cd "$work"
echo "fetch_kernel: downloading $packages"
# shellcheck disable=SC2086 # a list of words
apt-get download $packages >download.log 2>&1 || {
  cat download.log >&2
  die "apt-get download $packages failed. Is there a network? Are the lists fresh? Run: apt-get update"
}
for package in *.deb; do dpkg-deb -x "$package" root; done

# A module may be compressed; insmod of busybox wants it plain.
plain() {
  case $1 in
    *.xz) xz -dc "$1" ;;
    *.zst) zstd -qdc "$1" ;;
    *.gz) gzip -dc "$1" ;;
    *) cat "$1" ;;
  esac
}
modules=$folder/modules
mkdir -p "$modules"
for name in $wanted; do
  file=$(find root -name "$name.ko*" | head -n 1)
  [ -n "$file" ] || continue # built into this kernel, or not made for it: the guest says what is missing
  plain "$file" >"$work/$name.ko" || die "cannot unpack $file (install xz-utils, zstd)"
  mv "$work/$name.ko" "$modules/$name.ko" # at once: another test may be reading the old one
done
[ -e "$modules/vcan.ko" ] || die "$packages holds no vcan module"
cp root/boot/vmlinuz-* vmlinuz
mv vmlinuz "$folder/vmlinuz"
cd "$folder"
rm -rf "$work"
echo "$wanted" >"$folder/wanted"
echo "$release" >"$folder/version"
echo "fetch_kernel: kernel $release in $folder"
