# Finds SUMO's in-process C++ interface (libsumo).
# Looks in $SUMO_HOME first (an upstream SUMO: $SUMO_HOME/include, $SUMO_HOME/bin or lib, or a build
# tree with src/libsumo), then in the system's folders (Debian's package `sumo`).
# Defines the imported target SUMO::libsumo, SUMO_VERSION_HEADER_DIR, SUMO_NETCONVERT and SUMO_HOME_DIR.
set(_sumo_roots "$ENV{SUMO_HOME}")
find_path(SUMO_INCLUDE_DIR libsumo/libsumo.h HINTS ${_sumo_roots} PATH_SUFFIXES include src)
find_library(SUMO_LIBRARY sumocpp HINTS ${_sumo_roots} PATH_SUFFIXES bin lib lib64)
find_program(SUMO_NETCONVERT netconvert HINTS ${_sumo_roots} PATH_SUFFIXES bin)
if(NOT "$ENV{SUMO_HOME}" STREQUAL "")
  set(SUMO_HOME_DIR "$ENV{SUMO_HOME}")
else()
  find_path(SUMO_HOME_DIR data/xsd/net_file.xsd HINTS /usr/share/sumo /usr/local/share/sumo)
endif()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(SUMO
  REQUIRED_VARS SUMO_LIBRARY SUMO_INCLUDE_DIR SUMO_NETCONVERT SUMO_HOME_DIR
  REASON_FAILURE_MESSAGE "Install Debian's packages `sumo` and `sumo-tools`, or set SUMO_HOME to an upstream SUMO with libsumo.")
if(SUMO_FOUND AND NOT TARGET SUMO::libsumo)
  add_library(SUMO::libsumo UNKNOWN IMPORTED)
  set_target_properties(SUMO::libsumo PROPERTIES
    IMPORTED_LOCATION "${SUMO_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${SUMO_INCLUDE_DIR}")
endif()
mark_as_advanced(SUMO_INCLUDE_DIR SUMO_LIBRARY SUMO_NETCONVERT)
