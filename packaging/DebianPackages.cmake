# Binary packages: hedgehop, libhedgehop-dev, hedgehop-lcmtypes, hedgehop-doc, python3-hedgehop. Their summaries stand below, so the
# project's own is not set.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME hedgehop)
set(CPACK_PACKAGE_VENDOR "the hedgehop authors")
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_STRIP_FILES ON)
set(CPACK_PACKAGE_DIRECTORY "${PROJECT_BINARY_DIR}/deb")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "The hedgehop authors <hedgehop@example.org>")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_PRE_BUILD_SCRIPTS "${CMAKE_CURRENT_SOURCE_DIR}/before_packing.cmake")
set(CPACK_COMPONENTS_ALL tools development types documents)
if(TARGET hedgehop_python)
  list(APPEND CPACK_COMPONENTS_ALL python)
endif()

# hedgehop_package(component name summary description [ALL] [DEPENDS ...] [RECOMMENDS ...])
macro(hedgehop_package component name summary description)
  cmake_parse_arguments(PKG "ALL" "SECTION" "DEPENDS;RECOMMENDS;SUGGESTS" ${ARGN})
  string(TOUPPER ${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${name})
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "${summary}\n${description}")
  foreach(relation IN ITEMS DEPENDS RECOMMENDS SUGGESTS)
    if(PKG_${relation})
      list(JOIN PKG_${relation} ", " CPACK_DEBIAN_${upper}_PACKAGE_${relation})
    endif()
  endforeach()
  if(PKG_SECTION)
    set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION ${PKG_SECTION})
  endif()
  if(PKG_ALL)
    set(CPACK_DEBIAN_${upper}_PACKAGE_ARCHITECTURE all)
  endif()
  install(FILES debian/copyright "${CMAKE_CURRENT_BINARY_DIR}/changelog.gz"
    DESTINATION share/doc/${name} COMPONENT ${component})
  if(EXISTS "${CMAKE_CURRENT_SOURCE_DIR}/debian/${name}.lintian-overrides")
    install(FILES debian/${name}.lintian-overrides DESTINATION share/lintian/overrides RENAME ${name} COMPONENT ${component})
  endif()
endmacro()
execute_process(COMMAND "${GZIP}" -9nc "${CMAKE_CURRENT_SOURCE_DIR}/debian/changelog"
  OUTPUT_FILE "${CMAKE_CURRENT_BINARY_DIR}/changelog.gz" COMMAND_ERROR_IS_FATAL ANY)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/debian/changelog")

set(CPACK_DEBIAN_TOOLS_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_TOOLS_PACKAGE_CONTROL_EXTRA
  "${CMAKE_CURRENT_SOURCE_DIR}/debian/postinst;${CMAKE_CURRENT_SOURCE_DIR}/debian/prerm;${CMAKE_CURRENT_SOURCE_DIR}/debian/postrm")
hedgehop_package(tools hedgehop
  "contour flight planning over real terrain: programs and services"
  "Plans low-altitude (contour) helicopter flights: terrain and land-use files
go in; out comes a flight that stays low, keeps out of sight, goes around
villages, can be flown by a helicopter, and has been checked by code that
knows nothing of the planners.
.
This package holds the command line, five services that do the same over
LCM with their systemd units, manual pages and completion. It is a tool
for research; nothing here is certified for flight."
  DEPENDS proj-data
  RECOMMENDS gnuplot-nox fonts-dejavu-core
  SUGGESTS hedgehop-doc hedgehop-lcmtypes "default-jre-headless | java-runtime-headless" liblcm-java libjchart2d-java iproute2)
hedgehop_package(development libhedgehop-dev
  "contour flight planning over real terrain: libraries for C++"
  "Static libraries and headers of hedgehop, one library for each room of the
program: maps, preparation, planning, verification, exports, the bus. Found
with find_package(Hedgehop) or pkg-config."
  SECTION libdevel
  DEPENDS "hedgehop-lcmtypes (= ${PROJECT_VERSION})" liblcm-dev libglib2.0-dev libeigen3-dev libompl-dev libopencv-core-dev
          libopencv-imgproc-dev libyaml-cpp-dev libgdal-dev libproj-dev libosmium2-dev libtbb-dev libhwy-dev libnlopt-dev libzstd-dev
          libxxhash-dev libssl-dev libcurl4-openssl-dev libboost-dev libfmt-dev nlohmann-json3-dev libexpat1-dev libbz2-dev zlib1g-dev)
hedgehop_package(types hedgehop-lcmtypes
  "contour flight planning over real terrain: LCM message types"
  "What the services of hedgehop say to each other: the .lcm files, C++ headers
made of them that refuse damaged messages, and a Java archive with which
lcm-spy and lcm-logplayer-gui decode."
  ALL SECTION devel SUGGESTS liblcm-dev libglib2.0-dev liblcm-bin liblcm-java)
hedgehop_package(documents hedgehop-doc
  "contour flight planning over real terrain: documentation"
  "The documents of hedgehop: first steps, own regions, what the numbers mean,
services and bus, several machines, packages, troubleshooting."
  ALL SECTION doc)
if(TARGET hedgehop_python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
    "${CMAKE_CURRENT_SOURCE_DIR}/debian/python/postinst;${CMAKE_CURRENT_SOURCE_DIR}/debian/python/prerm")
  hedgehop_package(python python3-hedgehop
    "contour flight planning over real terrain: module for Python"
    "Maps as NumPy arrays, planning, verification, messages and logs of hedgehop
for Python."
    SECTION python DEPENDS "python3 (>= 3.11)" "python3 (<< 3.12)" python3-numpy)
endif()

include(CPack)
