#include "evaluation/kept_answers.hpp"

#include <utility>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/hash.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kVersion = 2;

}  // namespace

KeptAnswers::KeptAnswers(const std::filesystem::path& folder, const Json& identity)
    : question_(hash128(identity.dump()).hex()) {
  if (folder.empty()) {
    return;
  }
  folder_ = folder / question_;
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error) {
    throw SystemFailure("cannot make the folder " + folder_.string() + ": " + error.message(),
                        "choose another folder to keep results in");
  }
}

std::filesystem::path KeptAnswers::file_of(std::int64_t problem) const {
  return folder_ / (std::to_string(problem) + ".json");
}

std::optional<Json> KeptAnswers::find(std::int64_t problem) const {
  std::error_code error;
  if (folder_.empty() || !std::filesystem::is_regular_file(file_of(problem), error)) {
    return std::nullopt;
  }
  try {
    Json root = Json::parse(read_file(file_of(problem)));
    if (root.at("version").get<int>() != kVersion ||
        root.at("question").get<std::string>() != question_) {
      return std::nullopt;
    }
    return std::move(root.at("answer"));
  } catch (const Json::exception&) {
    return std::nullopt;
  } catch (const DataError&) {
    return std::nullopt;
  }
}

void KeptAnswers::keep(std::int64_t problem, Json answer) const {
  if (folder_.empty()) {
    return;
  }
  const Json root = {{"version", kVersion}, {"question", question_}, {"answer", std::move(answer)}};
  write_file_atomically(file_of(problem), root.dump() + "\n");
}

}  // namespace hedgehop::evaluation
