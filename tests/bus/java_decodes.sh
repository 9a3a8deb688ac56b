#!/usr/bin/env bash
# usage: java_decodes.sh EXAMPLE_LOG_PROGRAM TYPE_JAR LCM_JAR
# Every channel's example is decoded by the Java types, found by fingerprint as lcm-spy does.
set -euo pipefail
command -v java >/dev/null || { echo "SKIPPED: java is not installed"; exit 77; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$1" "$folder/log" > "$folder/expected"
java -Djava.awt.headless=true -cp "$3:$2" "$(dirname "$0")/DecodeLog.java" "$folder/log" > "$folder/talk" 2>&1 \
  || { cat "$folder/talk"; exit 1; }
sed -n 's/^DECODED //p' "$folder/talk" > "$folder/found"
[ "$(wc -l < "$folder/expected")" -ge 13 ] || { echo "only $(wc -l < "$folder/expected") channels"; exit 1; }
diff "$folder/expected" "$folder/found" || { cat "$folder/talk"; exit 1; }
echo "$(wc -l < "$folder/found") channels decoded by Java"
