#!/bin/sh
# Run by in_network_namespace.sh --no-route: what each command says where multicast has no route is one sentence of
# tiller's with the command that mends it, and nothing of liblcm's.
# usage: no_route.sh TILLER CART_POLE_TOML
set -eu
tiller=$1
robot=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

fail() { echo "FAILED: $*" >&2; exit 1; }

expect_one_sentence() { # what words...
  what=$1
  shift
  if "$@" >out.txt 2>&1; then fail "$what went on"; fi
  cat out.txt
  [ "$(grep -c 'ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo' out.txt)" = 1 ] || fail "$what: no remedy"
  [ "$(wc -l <out.txt)" = 1 ] || fail "$what: more than a sentence"
}

sed 's/^kind = "lcm"/kind = "lcm"\nliblcm = true/' "$robot" >liblcm.toml
grep -q 'liblcm = true' liblcm.toml || fail "the robot file has no [transport] kind"
"$tiller" run "$robot" --sim --seconds 0.2 --quiet --record run.mcap >/dev/null 2>&1
expect_one_sentence sim "$tiller" sim "$robot" --serve lcm --seconds 1
expect_one_sentence run "$tiller" run "$robot" --transport lcm --wait 1 --quiet
expect_one_sentence "run through liblcm" "$tiller" run liblcm.toml --transport lcm --wait 1 --quiet
expect_one_sentence replay "$tiller" replay run.mcap "$robot" --through lcm
echo passed
