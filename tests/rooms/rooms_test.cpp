// SPDX-License-Identifier: GPL-3.0-or-later
// Is the house in order? Reads ROOMS, walks the tree and fails on an include that is not listed, a source file that no room
// claims, a library outside its fence, and a number of an artefact or a recipe whose name carries no unit.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

std::string read(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

std::vector<std::string> words(const std::string& line) {
  std::istringstream in(line);
  std::vector<std::string> all;
  for (std::string w; in >> w;) all.push_back(w);
  return all;
}

struct House {
  std::map<std::string, std::set<std::string>> rooms;   // room -> rooms it may include
  std::map<std::string, std::set<std::string>> fences;  // "<CGAL" -> rooms
  std::set<std::string> bare;                           // names of numbers that need no unit
};

House read_house(const fs::path& file, std::vector<std::string>& faults) {
  House house;
  std::istringstream in(read(file));
  int number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    line = line.substr(0, line.find('#'));
    if (words(line).empty()) continue;
    const std::size_t colon = line.find(':');
    if (colon == std::string::npos) {
      faults.push_back("ROOMS:" + std::to_string(number) + ": no colon");
      continue;
    }
    const auto left = words(line.substr(0, colon)), right = words(line.substr(colon + 1));
    if (left.size() == 2 && left[0] == "fence") house.fences[left[1]].insert(right.begin(), right.end());
    else if (left.size() == 1 && left[0] == "bare") house.bare.insert(right.begin(), right.end());
    else if (left.size() == 1) house.rooms[left[0]].insert(right.begin(), right.end());
    else faults.push_back("ROOMS:" + std::to_string(number) + ": neither a room nor a fence nor bare names");
  }
  for (const auto& [room, may] : house.rooms)
    for (const std::string& other : may)
      if (!house.rooms.count(other)) faults.push_back("ROOMS: " + room + " may include " + other + ", which is no room");
  for (const auto& [fence, may] : house.fences)
    for (const std::string& other : may)
      if (!house.rooms.count(other) && other != "tests")
        faults.push_back("ROOMS: fence " + fence + " names " + other + ", which is no room");
  return house;
}

/// The room a path belongs to: the longest that is its beginning.
std::string room_of(const House& house, const std::string& path) {
  std::string best;
  for (const auto& [room, may] : house.rooms)
    if (path.compare(0, room.size() + 1, room + "/") == 0 && room.size() > best.size()) best = room;
  if (best.empty() && path.compare(0, 6, "tests/") == 0) return "tests";
  return best;
}

/// The text without comments and without what stands between quotes; line ends stay.
std::string bare_code(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.compare(i, 2, "//") == 0) {
      while (i < text.size() && text[i] != '\n') ++i;
      out += '\n';
    } else if (text.compare(i, 2, "/*") == 0) {
      const std::size_t end = text.find("*/", i + 2);
      out += std::string(
          std::size_t(std::count(text.begin() + std::ptrdiff_t(i), text.begin() + std::ptrdiff_t(std::min(end, text.size())), '\n')), '\n');
      if (end == std::string::npos) break;
      i = end + 1;
    } else if (text[i] == '"') {
      out += '"';
      for (++i; i < text.size() && text[i] != '"' && text[i] != '\n'; ++i)
        if (text[i] == '\\') ++i;
      out += '"';
    } else {
      out += text[i];
    }
  }
  return out;
}

bool is_name(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

bool has_unit(std::string name) {
  for (const char* bound : {"_min", "_max"})
    if (name.size() > 4 && name.compare(name.size() - 4, 4, bound) == 0) name.resize(name.size() - 4);
  static const std::set<std::string> units{"mm",  "mm2",   "mm3",   "um", "rad", "deg", "s", "ms", "N",  "kg",
                                           "rpm", "ratio", "count", "px", "mib", "W",   "A", "V",  "Hz", "K"};
  static const std::set<std::string> pairs{"mm_s",   "mm_s2", "mm_s3",  "mm3_s",  "rad_s", "rad_s2",
                                           "rad_s3", "deg_s", "deg_s2", "deg_s3", "N_mm",  "per_mm"};
  const std::size_t last = name.rfind('_');
  const std::string tail = last == std::string::npos ? name : name.substr(last + 1);
  if (units.count(tail)) return true;
  if (last == std::string::npos) return false;
  const std::size_t before = last == 0 ? std::string::npos : name.rfind('_', last - 1);
  return pairs.count(before == std::string::npos ? name : name.substr(before + 1)) > 0;
}

/// Names of members declared as numbers (double, float and lists of them) inside structs whose name `wanted` accepts.
template <class Wanted>
void numbers_without_unit(const std::string& path, const std::string& text, const House& house, Wanted&& wanted,
                          std::vector<std::string>& faults) {
  const std::string code = bare_code(text);
  std::vector<char> scopes;  // 's' a wanted struct, 'o' anything else
  std::string statement;
  int line = 1, begin = 1, depth = 0;
  const auto check = [&](std::string s) {
    if (scopes.empty() || scopes.back() != 's') return;
    // Template arguments say whether a number is inside; then they go, and parentheses mean a function.
    bool is_number = false;
    std::string flat;
    int angle = 0;
    std::string word;
    for (const char c : s + " ") {
      if (is_name(c)) {
        word += c;
      } else {
        if (word == "double" || word == "float") is_number = true;
        word.clear();
      }
      if (c == '<') ++angle;
      if (angle == 0) flat += c;
      if (c == '>') --angle;
    }
    const std::vector<std::string> head = words(flat);
    if (!is_number || head.empty() || head[0] == "using" || head[0] == "static" || head[0] == "friend" || head[0] == "return") return;
    const std::size_t equals = flat.find('='), paren = flat.find('(');
    if (paren != std::string::npos && (equals == std::string::npos || paren < equals)) return;
    // Declarators: the last word before '=', '{', ',' or the end, comma after comma, initialisers left out.
    std::string name;
    bool in_value = false;
    int nest = 0;
    std::vector<std::string> names;
    for (const char c : flat + ",") {
      if (c == '{' || c == '(') ++nest;
      if (c == '}' || c == ')') --nest;
      if (nest > 0 || c == '{' || c == '}') {
        in_value = true;
        continue;
      }
      if (c == ',') {
        const auto parts = words(name);
        if (!parts.empty()) names.push_back(parts.back());
        name.clear(), in_value = false;
      } else if (c == '=') {
        in_value = true;
      } else if (!in_value) {
        name += c;
      }
    }
    for (std::string n : names) {
      n = n.substr(0, n.find('['));
      if (!n.empty() && !has_unit(n) && !house.bare.count(n))
        faults.push_back(path + ":" + std::to_string(begin) + ": the number '" + n + "' carries no unit in its name");
    }
  };
  for (const char c : code) {
    if (c == '\n') ++line;
    if (c == '#' && words(statement).empty()) {  // a directive: up to the end of the line
      depth = -1;
    }
    if (depth == -1) {
      if (c == '\n') depth = 0;
      continue;
    }
    if (words(statement).empty()) begin = line;
    if (c == '{') {
      const auto head = words(statement);
      const bool is_struct =
          std::find(head.begin(), head.end(), "struct") != head.end() || std::find(head.begin(), head.end(), "class") != head.end();
      std::string name;
      for (std::size_t i = 0; i + 1 < head.size(); ++i)
        if (head[i] == "struct" || head[i] == "class") name = head[i + 1];
      const bool is_value = !is_struct && !scopes.empty() && scopes.back() == 's' && statement.find('(') == std::string::npos;
      if (is_value) {  // a braced initialiser belongs to the statement
        scopes.push_back('v');
        statement += c;
        continue;
      }
      scopes.push_back(is_struct && wanted(name) ? 's' : 'o');
      statement.clear();
    } else if (c == '}') {
      const bool was_value = !scopes.empty() && scopes.back() == 'v';
      if (!scopes.empty()) scopes.pop_back();
      if (was_value) statement += c;
      else statement.clear();
    } else if (c == ';') {
      if (scopes.empty() || scopes.back() != 'v') {
        check(statement);
        statement.clear();
      }
    } else {
      statement += c;
    }
  }
}

std::vector<std::string> check_tree(const fs::path& root) {
  std::vector<std::string> faults;
  const House house = read_house(root / "ROOMS", faults);
  std::vector<fs::path> files;
  for (auto it = fs::recursive_directory_iterator(root); it != fs::recursive_directory_iterator(); ++it) {
    const std::string name = it->path().filename().string();
    if (it->is_directory() && (name == "build" || name == "out" || name == ".git" || name == "shared")) {
      it.disable_recursion_pending();
      continue;
    }
    const std::string e = it->path().extension().string();
    if (e == ".cpp" || e == ".hpp" || e == ".h" || e == ".cc" || e == ".c") files.push_back(it->path());
  }
  std::sort(files.begin(), files.end());
  for (const fs::path& file : files) {
    const std::string path = file.lexically_relative(root).generic_string();
    const std::string room = room_of(house, path);
    if (room.empty()) {
      faults.push_back(path + ": no room claims this file");
      continue;
    }
    const std::string text = read(file);
    std::istringstream in(text);
    int number = 0;
    for (std::string line; std::getline(in, line);) {
      ++number;
      const auto w = words(line);
      std::string target;
      if (w.size() >= 2 && w[0] == "#include") target = w[1];
      else if (w.size() >= 3 && w[0] == "#" && w[1] == "include") target = w[2];
      else if (!w.empty() && w[0].compare(0, 9, "#include\"") == 0) target = w[0].substr(8);
      else if (!w.empty() && w[0].compare(0, 9, "#include<") == 0) target = w[0].substr(8);
      if (target.empty()) continue;
      const std::string where = path + ":" + std::to_string(number) + ": ";
      if (target.front() == '"') {
        const std::string inner = target.substr(1, target.rfind('"') - 1);
        const std::string other = room_of(house, inner);
        if (other.empty() || other == "tests") {
          if (room != "tests") faults.push_back(where + "includes " + inner + ", which lies in no room; write it from the root");
        } else if (room != "tests" && other != room && !house.rooms.at(room).count(other)) {
          faults.push_back(where + room + " may not include " + other);
        }
      } else if (room != "tests") {
        for (const auto& [fence, may] : house.fences)
          if (target.compare(0, fence.size(), fence) == 0 && !may.count(room))
            faults.push_back(where + room + " may not include " + target);
      }
    }
    if (file.extension() == ".hpp" && room == "planner/artefacts")
      numbers_without_unit(
          path, text, house, [](const std::string&) { return true; }, faults);
    else if (file.extension() == ".hpp" && room != "tests")
      numbers_without_unit(
          path, text, house, [](const std::string& name) { return name.size() > 6 && name.substr(name.size() - 6) == "Recipe"; }, faults);
  }
  return faults;
}

TEST(Rooms, the_house_is_in_order) {
  const auto faults = check_tree(fs::current_path());
  std::string text;
  for (const std::string& f : faults) text += f + "\n";
  EXPECT_TRUE(faults.empty()) << text;
}

TEST(Rooms, finds_what_is_planted) {
  const fs::path root = fs::path(testing::TempDir()) / "asbuilt_rooms";
  fs::remove_all(root);
  const auto write = [&](const char* path, const char* text) {
    fs::create_directories((root / path).parent_path());
    std::ofstream(root / path) << text;
  };
  write("ROOMS",
        "planner/base:\nplanner/artefacts: planner/base\nplanner/fit: planner/base planner/artefacts\nfence <CGAL: planner/fit\nbare: "
        "limit\n");
  write("planner/base/a.hpp", "#include \"planner/fit/fit.hpp\"\n");
  write("planner/base/b.cpp", "#include <CGAL/Simple_cartesian.h>\n");
  write("planner/stray.cpp", "int x;\n");
  write("planner/fit/fit.hpp",
        "#pragma once\n#include <CGAL/Simple_cartesian.h>\n#include \"planner/base/a.hpp\"\nstruct FitRecipe { double share = 0.5; double "
        "width_mm{1}, other = f(2); };\nstruct Inner { double anything; };\n");
  write("planner/artefacts/x.hpp",
        "// double in_a_comment = 0;\nstruct X {\n  double limit = 0;\n  std::vector<std::array<double, 6>> q_rad, joints;\n  double "
        "speed_mm_s = 0, length = 3;\n"
        "  std::array<double, 2> range{1.0, 2.0};\n  double norm(double a) const { double inside = a; return inside; }\n  template <class "
        "S, class A>\n  static void visit(S& s, A&& a) { a(\"x\", s.length); }\n};\n");
  std::string text;
  for (const std::string& f : check_tree(root)) text += f + "\n";
  EXPECT_EQ(text,
            "planner/artefacts/x.hpp:4: the number 'joints' carries no unit in its name\n"
            "planner/artefacts/x.hpp:5: the number 'length' carries no unit in its name\n"
            "planner/artefacts/x.hpp:6: the number 'range' carries no unit in its name\n"
            "planner/base/a.hpp:1: planner/base may not include planner/fit\n"
            "planner/base/b.cpp:1: planner/base may not include <CGAL/Simple_cartesian.h>\n"
            "planner/fit/fit.hpp:4: the number 'share' carries no unit in its name\n"
            "planner/fit/fit.hpp:4: the number 'other' carries no unit in its name\n"
            "planner/stray.cpp: no room claims this file\n");
  fs::remove_all(root);
}

}  // namespace
