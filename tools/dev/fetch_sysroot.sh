#!/bin/sh
# fetch_sysroot.sh FOLDER ARCHITECTURE RELEASE|- PACKAGE...: unpacks Debian packages of another architecture into
# FOLDER, with all that they depend on: libraries to link with, an interpreter to run under qemu-user. Nothing is
# installed, and this machine's apt stays as it is: lists and packages are kept in FOLDER/apt while they are needed.
#
# The packages come from where this machine's own come from; RELEASE (trixie, ...) asks there for another release than
# this machine's. FOLDER/packages lists what was unpacked; it is written last, so its presence means complete.
#
# Does nothing if FOLDER is complete. Safe to run twice at once.
set -eu

usage='usage: fetch_sysroot.sh FOLDER ARCHITECTURE RELEASE|- PACKAGE...'
folder=${1:?$usage}
architecture=${2:?$usage}
release=${3:?$usage}
shift 3
wanted="$architecture $release $*"
die() { printf 'fetch_sysroot: %s\n' "$*" >&2; exit 1; }

mkdir -p "$folder"
folder=$(CDPATH='' cd -- "$folder" && pwd)
exec 9>"$folder/lock"
flock 9
[ -s "$folder/packages" ] && [ "$(head -n 1 "$folder/packages")" = "$wanted" ] && exit 0
for tool in apt-get dpkg-deb; do
  command -v $tool >/dev/null || die "no $tool here: unpack $* for $architecture into $folder/tree yourself, then write" \
    "'$wanted' into $folder/packages"
done

apt=$folder/apt
rm -rf "$apt" "$folder/packages" "$folder/tree"
mkdir -p "$apt/lists/partial" "$apt/archives/partial" "$apt/sources" "$folder/tree"
: >"$apt/status"
for source in /etc/apt/sources.list /etc/apt/sources.list.d/*.list /etc/apt/sources.list.d/*.sources; do
  [ -e "$source" ] && cp "$source" "$apt/sources/$(basename "$source" | sed 's/^sources\.list$/own.list/')"
done
if [ "$release" != - ]; then
  # shellcheck disable=SC1091
  own=$(. /etc/os-release && [ "$ID" = debian ] && echo "${VERSION_CODENAME:-}") || own=
  [ -n "$own" ] || die "$release is a release of Debian, and /etc/os-release names none here: unpack $* of it for" \
    "$architecture into $folder/tree yourself, then write '$wanted' into $folder/packages"
  sed -i "s/\\b$own/$release/g" "$apt"/sources/*
fi
own_apt() {
  apt-get -o APT::Architecture="$architecture" -o APT::Architectures="$architecture" -o Dir::State="$apt" \
    -o Dir::State::status="$apt/status" -o Dir::Cache="$apt" -o Dir::Etc::sourcelist=/dev/null \
    -o Dir::Etc::sourceparts="$apt/sources" -o APT::Sandbox::User= -o Debug::NoLocking=1 "$@"
}
own_apt update >"$apt/log" 2>&1 || { cat "$apt/log" >&2; die "the package lists for $architecture cannot be had"; }
echo "fetch_sysroot: downloading $* for $architecture"
own_apt install --no-install-recommends --download-only -y "$@" >"$apt/log" 2>&1 || {
  cat "$apt/log" >&2
  die "these packages cannot be had for $architecture: $*"
}
for package in "$apt"/archives/*.deb; do dpkg-deb -x "$package" "$folder/tree"; done
[ -e "$folder/tree/lib" ] || ln -s usr/lib "$folder/tree/lib" # newer releases leave this link to a package of its own
find "$folder/tree" -lname '/*' | while read -r link; do # they mean the target's own root
  ln -sfn "$folder/tree$(readlink "$link")" "$link"
done
names=$(basename -a "$apt"/archives/*.deb)
rm -rf "$apt"
printf '%s\n' "$wanted" "$names" >"$folder/packages"
echo "fetch_sysroot: $(echo "$names" | wc -l) packages in $folder/tree"
