// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/history.hpp"

#include <sqlite3.h>

#include "planner/base/archive.hpp"

namespace asbuilt {

namespace {

class Statement {
 public:
  Statement(sqlite3* database, const char* sql) { sqlite3_prepare_v2(database, sql, -1, &statement_, nullptr); }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;
  Statement& bind(const std::string& text) {
    sqlite3_bind_text(statement_, ++bound_, text.data(), static_cast<int>(text.size()), SQLITE_TRANSIENT);
    return *this;
  }
  Statement& bind(double number) {
    sqlite3_bind_double(statement_, ++bound_, number);
    return *this;
  }
  Statement& bind(sqlite3_int64 number) {
    sqlite3_bind_int64(statement_, ++bound_, number);
    return *this;
  }
  bool step() { return sqlite3_step(statement_) == SQLITE_ROW; }
  std::string text(int column) const {
    const auto* t = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    return t ? std::string(t, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column))) : std::string();
  }
  double number(int column) const { return sqlite3_column_double(statement_, column); }
  sqlite3_int64 integer(int column) const { return sqlite3_column_int64(statement_, column); }

 private:
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

sqlite3* opened(const std::shared_ptr<void>& p) { return static_cast<sqlite3*>(p.get()); }

constexpr const char* kTables = R"(
create table if not exists runs(run integer primary key autoincrement, item text, status text, inputs text);
create table if not exists stages(run integer, place integer, stage text, what text, time_s real, memory_mib real, key text, parts text);
create index if not exists runs_by_item on runs(item);
create index if not exists stages_by_run on stages(run);
)";

using Texts = std::map<std::string, std::string>;

Texts texts_of(const std::string& json) {
  const Json j = Json::parse(json, nullptr, false);
  Texts t;
  if (j.is_object())
    for (const auto& [k, v] : j.items())
      if (v.is_string()) t[k] = v.get<std::string>();
  return t;
}

struct PastStage {
  std::string stage, what;
  double time_s = 0, memory_mib = 0;
  Texts parts;
};

std::vector<PastStage> stages_of(sqlite3* database, sqlite3_int64 run) {
  std::vector<PastStage> stages;
  Statement s(database, "select stage, what, time_s, parts, memory_mib from stages where run = ? order by place");
  s.bind(run);
  while (s.step()) stages.push_back({s.text(0), s.text(1), s.number(2), s.number(4), texts_of(s.text(3))});
  return stages;
}

}  // namespace

History::History(const std::filesystem::path& file) {
  std::error_code ignored;
  std::filesystem::create_directories(file.parent_path(), ignored);
  sqlite3* database = nullptr;
  const bool is_open = sqlite3_open(file.c_str(), &database) == SQLITE_OK;
  database_ = std::shared_ptr<void>(database, [](void* p) { sqlite3_close(static_cast<sqlite3*>(p)); });
  if (!is_open || sqlite3_exec(database, kTables, nullptr, nullptr, nullptr) != SQLITE_OK) database_.reset();
  if (database_) sqlite3_busy_timeout(database, 5000);
}

void History::add(const BatchLine& line, const std::vector<StageEvent>& stages) {
  if (!database_) return;
  sqlite3* database = opened(database_);
  sqlite3_exec(database, "begin", nullptr, nullptr, nullptr);
  Json inputs = Json::object();
  const Json result = Json::parse(line.result_json, nullptr, false);
  if (result.is_object() && result.contains("inputs"))
    for (const Json& input : result["inputs"]) inputs[input.value("path", "")] = input.value("sha256", "");
  Statement run(database, "insert into runs(item, status, inputs) values(?, ?, ?)");
  run.bind(line.item_id).bind(std::string(name_of(line.status))).bind(inputs.dump()).step();
  const sqlite3_int64 id = sqlite3_last_insert_rowid(database);
  sqlite3_int64 place = 0;
  for (const StageEvent& e : stages) {
    Statement s(database, "insert into stages values(?, ?, ?, ?, ?, ?, ?, ?)");
    s.bind(id).bind(place++).bind(e.stage).bind(std::string(name_of(e.what))).bind(e.time_s).bind(e.peak_memory_mib).bind(e.key);
    s.bind(Json(e.parts).dump()).step();
  }
  sqlite3_exec(database, "commit", nullptr, nullptr, nullptr);
}

std::optional<std::set<std::string>> History::latest_keys(int runs_count) const {
  if (!database_) return std::nullopt;
  std::set<std::string> keys;
  Statement s(opened(database_), "select key from stages where key != '' and run in "
                                 "(select run from (select run, row_number() over (partition by item order by run desc) as place from runs) where place <= ?)");
  s.bind(static_cast<sqlite3_int64>(runs_count));
  while (s.step()) keys.insert(s.text(0));
  return keys;
}

std::optional<Why> History::why(const std::string& item_id) const {
  if (!database_) return std::nullopt;
  sqlite3* database = opened(database_);
  Statement runs(database, "select run, inputs from runs where item = ? order by run desc limit 2");
  runs.bind(item_id);
  if (!runs.step()) return std::nullopt;
  const std::vector<PastStage> latest = stages_of(database, runs.integer(0));
  const Texts files = texts_of(runs.text(1));
  std::vector<PastStage> before;
  Texts files_before;
  const bool has_before = runs.step();
  if (has_before) before = stages_of(database, runs.integer(0)), files_before = texts_of(runs.text(1));

  Why why;
  for (std::size_t i = 0; i < latest.size(); ++i) {
    WhyLine line{latest[i].stage, latest[i].what, {}, latest[i].time_s, latest[i].memory_mib};
    const bool has_match = i < before.size() && before[i].stage == latest[i].stage;
    if (!has_match) line.changed = {"first run"};
    else
      for (const auto& [part, hash] : latest[i].parts) {
        const auto old = before[i].parts.find(part);
        if (old == before[i].parts.end() || old->second != hash) line.changed.push_back(part);
      }
    why.stages.push_back(std::move(line));
  }
  for (const auto& [path, hash] : files) {
    const auto old = files_before.find(path);
    if (!has_before) continue;
    if (old == files_before.end()) why.files.push_back(path + ": new");
    else if (old->second != hash) why.files.push_back(path + ": changed");
  }
  for (const auto& [path, hash] : files_before)
    if (!files.contains(path)) why.files.push_back(path + ": gone");
  return why;
}

std::optional<Why> why_item(const std::filesystem::path& out, const std::string& item_id) {
  const std::filesystem::path file = out / "store" / "history.sqlite";
  if (!std::filesystem::exists(file)) return std::nullopt;
  return History(file).why(item_id);
}

}  // namespace asbuilt
