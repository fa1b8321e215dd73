# SPDX-License-Identifier: GPL-3.0-or-later
# Turns the page's files into one C++ source of raw strings, in pieces that every compiler takes.
file(WRITE ${OUT}.new "// Made from planner/report/page by embed.cmake.\n#include \"planner/report/page_files.hpp\"\nnamespace asbuilt {\n")
foreach(name style.css viewer.js charts.js page.js)
  file(READ ${DIR}/${name} text)
  string(REPLACE "." "_" id ${name})
  file(APPEND ${OUT}.new "const char* const page_${id} = R\"~~(${text})~~\";\n")
endforeach()
file(APPEND ${OUT}.new "}  // namespace asbuilt\n")
file(RENAME ${OUT}.new ${OUT})
