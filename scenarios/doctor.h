#pragma once

namespace lanewise {

/// Prints what Lanewise found on this machine (SUMO, libraries, versions) and drives a shipped network for
/// two simulated seconds. @return true if everything works.
bool RunDoctor();

}  // namespace lanewise
