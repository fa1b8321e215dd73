// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/inputs/sources.hpp"

#include "planner/base/hash.hpp"

namespace asbuilt::inputs {

namespace fs = std::filesystem;

Sources::Sources(const fs::path& root, bool allow_outside) : allow_outside_(allow_outside) {
  std::error_code error;
  root_ = fs::weakly_canonical(root.empty() ? fs::path(".") : root, error);
  if (error) root_ = fs::absolute(root);
}

std::optional<fs::path> Sources::resolve(Readout& naming, const std::string& field, const fs::path& naming_file,
                                         const std::string& text) const {
  std::error_code error;
  const fs::path file = fs::weakly_canonical(naming_file.parent_path() / fs::path(text), error);
  if (error) {
    naming.fault("input.bad_path", field, "found the path '" + shown(text) + "', which leads nowhere (" + error.message() + ")");
    return std::nullopt;
  }
  const fs::path inside = file.lexically_relative(root_);
  if (!allow_outside_ && (inside.empty() || *inside.begin() == "..")) {
    naming.fault("input.path_outside", field,
                 "found the path '" + shown(text) + "', which leaves the batch's folder; allowed inside it, or with --allow-outside");
    return std::nullopt;
  }
  return file;
}

std::optional<std::string> Sources::read(Readout& naming, const std::string& field, const fs::path& file) {
  auto bytes = read_file(file, name_of(file));
  if (!bytes) {
    for (const Refusal& r : bytes.error()) naming.fault(r.code, field, "names " + r.where + ": " + r.message);
    return std::nullopt;
  }
  const std::string name = name_of(file);
  if (!hashes_.count(name)) hashes_[name] = sha256_hex(*bytes);
  return std::move(*bytes);
}

std::string Sources::name_of(const fs::path& file) const {
  std::string name = file.lexically_relative(root_).generic_string();
  if (name.empty()) name = file.generic_string();
  return first_not_utf8(name) ? shown(name) : name;
}

std::vector<InputFile> Sources::files() const {
  std::vector<InputFile> all;
  for (const auto& [name, hash] : hashes_) all.push_back({name, hash});
  return all;
}

}  // namespace asbuilt::inputs
