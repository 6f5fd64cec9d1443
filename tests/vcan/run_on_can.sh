#!/bin/sh
# Runs programs where there is a CAN bus: on this kernel if it has AF_CAN and lets us make virtual interfaces in a
# network namespace of our own, else in a guest with a kernel of its own. Never skips: if neither works, it fails
# and says what to install. Arguments are those of run_in_guest.sh, which explains them.
set -eu
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)

isolated="unshare -rn"
[ "$(id -u)" -eq 0 ] && isolated="unshare -n"
# shellcheck disable=SC2086 # two words
if ! why=$($isolated "$here/can_interfaces.sh" 2>&1); then
  echo "virtual CAN: not on this kernel ($(echo "$why" | tail -n 1)); starting a guest"
  exec "$here/run_in_guest.sh" "$@"
fi

# shellcheck source=tests/vcan/stage.sh
. "$here/stage.sh"
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
parse_arguments "$@"
stage_tests "$folder"
cp "$here/can_interfaces.sh" "$folder/can_interfaces.sh"
echo "virtual CAN: on this kernel, $(uname -r)"
code=0
# shellcheck disable=SC2086
(cd "$folder" &&
  PATH=$folder:$PATH timeout -k 5 "$limit_s" $isolated sh -c './can_interfaces.sh && . ./commands') || code=$?
echo "VIRTUAL CAN: exit $code"
exit "$code"
