#!/usr/bin/env python3
"""Manual pages of the services, made from what each says with --help.

  service_pages.py FOLDER PROGRAM...
"""

import pathlib
import subprocess
import sys


def roff(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text[:1] in ".'" else text


def page(program):
    name = program.name
    said = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    version = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout.split()[1]
    purpose, options = said.split("\n\nOptions:\n")
    purpose = purpose[len(name) + 2:]
    lines = [f'.TH "{name.upper()}" 1 "" "hedgehop {version}" "hedgehop"', ".SH NAME",
             f"{roff(name)} \\- {roff(purpose[0].lower() + purpose[1:])}", ".SH SYNOPSIS",
             f".B {roff(name)}", "[\\fIOPTIONS\\fR]", ".SH DESCRIPTION",
             f"{roff(purpose)}. One of the services that \\fBhedgehop serve\\fR starts together.", ".SH OPTIONS"]
    for line in options.rstrip("\n").split("\n"):
        text = roff(line.strip())
        if line.startswith("      "):
            lines.append(text)
        else:
            option, _, value = text.partition(" ")
            lines += [".TP", f"\\fB{option}\\fR" + (f" \\fI{value}\\fR" if value else "")]
    lines += [".SH ENVIRONMENT", ".TP", "LCM_DEFAULT_URL", "The bus, when \\fB\\-\\-lcm\\-url\\fR is not given.", ".TP",
              "NOTIFY_SOCKET", "Set by systemd: READY, WATCHDOG and STATUS are told there.", ".SH SEE ALSO",
              "\\fBhedgehop\\-serve\\fR(1)"]
    return "\n".join(lines) + "\n"


def main():
    folder = pathlib.Path(sys.argv[1])
    for program in map(pathlib.Path, sys.argv[2:]):
        (folder / f"{program.name}.1").write_text(page(program))


if __name__ == "__main__":
    main()
