#!/usr/bin/env bash
# Writes prometheusrule.yaml from the rules of deploy/prometheus, which are the only ones that are edited by hand.
set -euo pipefail
cd "$(dirname "$0")"
{
    cat <<'HEAD'
# Written by render-rules.sh from deploy/prometheus/slipdrive.rules.yml: change that.
apiVersion: monitoring.coreos.com/v1
kind: PrometheusRule
metadata:
  name: slipdrive
  labels:
    app.kubernetes.io/name: slipdrive
spec:
HEAD
    grep -v '^#' ../../../prometheus/slipdrive.rules.yml | sed 's/^\(.\)/  \1/'
} >prometheusrule.yaml
