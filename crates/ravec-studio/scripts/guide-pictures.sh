#!/usr/bin/env bash
# Takes the pictures of the guide from the running program: plays the scripts guide*.json in a window.
#
#   crates/ravec-studio/scripts/guide-pictures.sh
#
# Needs a display, or xvfb-run (package xvfb). Writes docs/images/studio-*.jpg; those that the guide does not show are removed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../../.."
cargo build --release -p ravec-studio
window=()
if [ -z "${DISPLAY:-}" ] && [ -z "${WAYLAND_DISPLAY:-}" ]; then
  window=(xvfb-run -a -s "-screen 0 1280x820x24")
fi
for script in crates/ravec-studio/scripts/guide*.json; do
  "${window[@]}" target/release/ravec-studio --measure "$script" --window --pictures docs/images
done
for picture in docs/images/studio-*.jpg; do
  grep -q "$(basename "$picture")" docs/guide/studio.md || rm "$picture"
done
