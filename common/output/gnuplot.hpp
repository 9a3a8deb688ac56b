#pragma once

#include <filesystem>
#include <string>

namespace hedgehop::output {

/// Runs `gnuplot SCRIPT` in `folder` without a shell and without the user's own settings, after the
/// command `first`. Throws SystemFailure with what gnuplot said if it is missing, fails or is
/// killed.
void run_gnuplot(const std::filesystem::path& folder, const std::string& script,
                 const std::string& first = "");

/// Text as a single-quoted gnuplot string on one line, in which nothing is expanded. Control
/// characters and broken UTF-8 become spaces and question marks; cut off after `characters_max`.
std::string gnuplot_quoted(const std::string& text, std::size_t characters_max);

}  // namespace hedgehop::output
