// SPDX-License-Identifier: GPL-3.0-or-later
// What a finished item leaves on disk. Programs are written aside, read again, compared with what was checked, then renamed.
#include <fmt/format.h>
#include <unistd.h>

#include "planner/base/hash.hpp"
#include "planner/pipeline/pipeline.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

namespace fs = std::filesystem;

void withdraw_item(const fs::path& out, const std::string& item_id) {
  const fs::path folder = out / item_id;
  for (const char* name : {"programs", ".programs", "result.json", "report.html"}) fs::remove_all(folder / name);
}

namespace {

void release_programs(const fs::path& folder, const ItemRecord& record) {
  const fs::path aside = folder / ".programs";
  fs::remove_all(aside);
  for (const ReleasedProgram& program : record.programs) {
    must(program.verdict.is_ok(), "a program with a failed check came to the release");
    for (const ProgramFile& file : program.text.files) {
      const fs::path path = aside / name_of(program.text.language) / file.name;
      write_file_whole(path, file.bytes);
      const auto again = read_file_whole(path);
      if (!again || sha256_hex(*again) != sha256_hex(file.bytes))
        throw std::runtime_error(fmt::format("{}: what was written is not what was checked; nothing was emitted", file.name));
    }
  }
  fs::rename(aside, folder / "programs");
}

}  // namespace

void write_item(const fs::path& out, const ItemRecord& record) {
  withdraw_item(out, record.item_id);
  const fs::path folder = out / record.item_id;
  fs::create_directories(folder);
  const ItemReport report = make_report(record);
  write_file_whole(folder / "report.html", report.report_html);
  if (record.status == ItemStatus::emitted) release_programs(folder, record);
  write_file_whole(folder / "result.json", report.result_json);
}

}  // namespace asbuilt
