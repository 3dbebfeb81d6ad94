#include "libsumo_bridge/sumo_session.h"

#include <libsumo/libsumo.h>

#include <cstdlib>
#include <exception>

namespace lanewise {
namespace {

/// Runs a SUMO call and turns whatever it throws into SumoError.
template <class F>
void Guard(const char* call, F&& f) {
  try {
    f();
  } catch (const std::exception& error) {
    throw SumoError(std::string("SUMO failed in ") + call + ": " + error.what());
  }
}

}  // namespace

SumoSession::SumoSession(const std::vector<std::string>& options) {
  EnsureHome();
  std::vector<std::string> command{"sumo"};
  command.insert(command.end(), options.begin(), options.end());
  Guard("start", [&] { libsumo::Simulation::start(command); });
}

SumoSession::~SumoSession() {
  try {
    libsumo::Simulation::close();
  } catch (...) {  // SUMO may already be down; there is nothing left to save.
  }
}

void SumoSession::Step() {
  Guard("step", [] { libsumo::Simulation::step(); });
}

double SumoSession::time() const {
  return libsumo::Simulation::getTime();
}
double SumoSession::step_length() const {
  return libsumo::Simulation::getDeltaT();
}
int SumoSession::ExpectedNumber() const {
  return libsumo::Simulation::getMinExpectedNumber();
}
std::string SumoSession::Version() {
  return libsumo::Simulation::getVersion().second;
}

std::string SumoSession::EnsureHome() {
  const char* home = std::getenv("SUMO_HOME");
  if (home != nullptr && *home != '\0') return home;
  setenv("SUMO_HOME", LANEWISE_SUMO_HOME, 1);
  return LANEWISE_SUMO_HOME;
}

}  // namespace lanewise
