// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/e2e/run_program.hpp"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

namespace asbuilt::test {

namespace fs = std::filesystem;

Folder::Folder() {
  std::string name = (fs::temp_directory_path() / "asbuilt-e2e-XXXXXX").string();
  path = ::mkdtemp(name.data());
}
Folder::~Folder() {
  std::error_code ignored;
  if (!std::getenv("KEEP_E2E")) fs::remove_all(path, ignored);
}

std::string read_text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream s;
  s << in.rdbuf();
  return s.str();
}

void write_text(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

Ran run_program(const std::vector<std::string>& words) {
  const Folder folder;
  const fs::path out = folder.path / "out", err = folder.path / "err";
  std::vector<std::string> all{ASBUILT_PROGRAM};
  all.insert(all.end(), words.begin(), words.end());
  std::vector<char*> argv;
  for (std::string& w : all) argv.push_back(w.data());
  argv.push_back(nullptr);
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::dup2(::open(out.c_str(), O_CREAT | O_WRONLY, 0600), 1);
    ::dup2(::open(err.c_str(), O_CREAT | O_WRONLY, 0600), 2);
    ::execv(argv[0], argv.data());
    ::_exit(126);
  }
  int status = 0;
  ::waitpid(pid, &status, 0);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), read_text(out), read_text(err)};
}

Json result_of(const fs::path& out, const std::string& item) {
  Json j = Json::parse(read_text(out / item / "result.json"), nullptr, false);
  return j.is_discarded() ? Json::object() : j;
}

std::map<std::string, std::string> what_came_out(const fs::path& out) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(out)) {
    if (!entry.is_regular_file()) continue;
    const std::string path = fs::relative(entry.path(), out).string();
    if (path.starts_with("store/")) continue;
    if (path.find("/programs/") != std::string::npos) files[path] = read_text(entry.path());
    if (entry.path().filename() == "result.json") {
      Json j = Json::parse(read_text(entry.path()));
      j.erase("timing_s");
      files[path] = j.dump(1);
    }
  }
  return files;
}

}  // namespace asbuilt::test
