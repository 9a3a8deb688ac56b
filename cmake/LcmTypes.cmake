# lcm-gen 1.3.1 of Debian 12 comes without CMake files. hedgehop::lcmtypes is written by the lcmtypes folder.
find_program(LCM_GEN lcm-gen REQUIRED)
