#!/usr/bin/env bash
# Replays the golden bags of tests/golden through controller and diagnosis and compares every field
# with the committed references; --update writes the references anew, --bags the bags with them.
#   scripts/golden.sh [--update | --bags] [control] [diagnosis]
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,4s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
# OpenBLAS and NumPy pick their kernels by the processor, and the kernels' last digits grow in the
# diagnosis' searches to percents of an error: references are of what every processor with AVX2 has.
export OPENBLAS_CORETYPE=Haswell NPY_DISABLE_CPU_FEATURES="X86_V4 AVX512_ICL AVX512_SPR"
exec python -m hydro_ident.study.golden --folder "$hydro_root/tests/golden" "$@"
