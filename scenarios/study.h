#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "scenarios/study/study_plan.h"

namespace lanewise {

/// `lanewise study`: every run of a study file, once. Sets `chosen` if it is the subcommand.
void AddStudyCommand(CLI::App* app, const RunInterface& run, std::function<int()>* chosen);

}  // namespace lanewise
