#pragma once

namespace lanewise {

// Where this build keeps things. In a file of their own, so that nothing else has to be compiled anew for
// another folder.
extern const char* const kLanewiseBinary;
extern const char* const kNetworksFolder;  ///< The built networks.
extern const char* const kStudiesFolder;   ///< The shipped studies.
extern const char* const kSumoHome;        ///< As found when configured.
extern const char* const kNetconvert;      ///< SUMO's program.
extern const char* const kBolognaFolder;   ///< Of SUMO's Bologna scenarios; may not exist.

}  // namespace lanewise
