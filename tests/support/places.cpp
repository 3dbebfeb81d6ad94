#include "tests/support/places.h"

namespace lanewise {

const char* const kLanewiseBinary = LANEWISE_BINARY;
const char* const kNetworksFolder = LANEWISE_NETWORKS_FOLDER;
const char* const kStudiesFolder = LANEWISE_STUDIES_FOLDER;
const char* const kSumoHome = LANEWISE_SUMO_HOME;
const char* const kNetconvert = LANEWISE_NETCONVERT;
const char* const kBolognaFolder = LANEWISE_BOLOGNA_FOLDER;

}  // namespace lanewise
