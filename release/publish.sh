#!/usr/bin/env bash
# What is left of a release once `make release` has made build/release: everything that needs a key or a
# network. Prints what it would do; with --really it does it.
set -euo pipefail
cd "$(dirname "$0")/../build/release"
version=$(basename soter_rta-*.whl | cut -d- -f2)

step() {
  echo "$*"
  if [ "${really:-}" ]; then "$@"; fi
}

if [ "${1:-}" = --really ]; then really=yes; else echo "would run, in build/release (--really runs it):"; fi
step sha256sum --check --quiet SHA256SUMS
step gpg --armor --detach-sign SHA256SUMS
step git tag --sign "v$version" --file notes.md --cleanup verbatim
step git push origin "v$version"
step python3 -m twine upload soter_rta-*.whl soter_rta-*.tar.gz
