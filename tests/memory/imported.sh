#!/bin/sh
# imported.sh TILLER EVERY_PLANNER TICKS FOLDER "DESCRIPTION [OPTIONS]"...: each description of the folder as it is
# imported, so many ticks with every planner.
# MEMCHECK in the environment goes before the program.
set -eu
tiller=$1 every_planner=$2 ticks=$3 from=$4
shift 4
rm -rf imported && mkdir imported
for description; do
  # shellcheck disable=SC2086  # a description and its options are several words
  "$tiller" import "$from"/$description -o "imported/${description%%.*}"
done
$MEMCHECK "$every_planner" "$ticks" imported/*/robot.toml
