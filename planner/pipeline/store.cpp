// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/store.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <fstream>

#include "planner/base/archive.hpp"

namespace asbuilt {

namespace fs = std::filesystem;

std::optional<std::string> read_file_whole(const fs::path& file) {
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in) return std::nullopt;
  const auto size = in.tellg();
  if (size < 0) return std::nullopt;
  std::string bytes(static_cast<std::size_t>(size), '\0');
  in.seekg(0);
  in.read(bytes.data(), size);
  if (!in) return std::nullopt;
  return bytes;
}

void write_file_whole(const fs::path& file, const std::string& bytes) {
  fs::create_directories(file.parent_path());
  const fs::path aside = file.parent_path() / fmt::format(".{}.{}", file.filename().string(), ::getpid());
  {
    std::ofstream out(aside, std::ios::binary | std::ios::trunc);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    out.flush();
    if (!out) {
      std::error_code ignored;
      fs::remove(aside, ignored);
      throw std::runtime_error(fmt::format("cannot write {}: is the disk full or the folder read-only?", file.string()));
    }
  }
  fs::rename(aside, file);
}

namespace {
fs::path place(const fs::path& folder, const char* kind, const std::string& hash) { return folder / kind / hash.substr(0, 2) / hash; }
}  // namespace

std::optional<Outcome> Store::find(const std::string& key) const {
  const auto bytes = read_file_whole(place(folder_, "keys", key));
  if (!bytes) return std::nullopt;
  try {
    Outcome outcome = from_bytes<Outcome>(*bytes);
    if (outcome.is_done && !fs::exists(place(folder_, "objects", outcome.artefact_hash))) return std::nullopt;
    return outcome;
  } catch (const Bug&) {
    return std::nullopt;
  }
}

std::optional<std::string> Store::load(const std::string& artefact_hash) const {
  auto bytes = read_file_whole(place(folder_, "objects", artefact_hash));
  if (!bytes || sha256_hex(*bytes) != artefact_hash) return std::nullopt;
  return bytes;
}

void Store::keep(const std::string& key, const Outcome& outcome) { write_file_whole(place(folder_, "keys", key), to_bytes(outcome)); }

void Store::keep_object(const std::string& artefact_hash, const std::string& bytes) {
  const fs::path file = place(folder_, "objects", artefact_hash);
  std::error_code none;
  if (fs::exists(file) && fs::file_size(file, none) == bytes.size()) return;
  write_file_whole(file, bytes);
}

std::size_t Store::prune(const std::set<std::string>& keys, double days) {
  const auto now = fs::file_time_type::clock::now();
  const auto is_young = [&](const fs::directory_entry& e) { return now - e.last_write_time() < std::chrono::duration<double>(86400 * days); };
  const auto files_of = [&](const char* kind) {
    std::vector<fs::directory_entry> files;
    std::error_code none;
    for (fs::recursive_directory_iterator it(folder_ / kind, none), end; it != end; it.increment(none))
      if (it->is_regular_file(none)) files.push_back(*it);
    return files;
  };
  std::size_t count = 0;
  std::error_code ignored;
  std::set<std::string> artefacts;
  for (const fs::directory_entry& e : files_of("keys")) {
    const std::string key = e.path().filename().string();
    if (!keys.contains(key) && !is_young(e)) {
      count += fs::remove(e.path(), ignored);
    } else if (const auto outcome = find(key)) {
      artefacts.insert(outcome->artefact_hash);
    }
  }
  for (const fs::directory_entry& e : files_of("objects"))
    if (!artefacts.contains(e.path().filename().string()) && !is_young(e)) count += fs::remove(e.path(), ignored);
  return count;
}

}  // namespace asbuilt
