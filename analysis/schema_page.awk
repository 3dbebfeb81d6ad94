# Turns the schema and the views into docs/schema.md: the comment before a table or view, and the table of its columns.
# Usage: awk -f schema_page.awk results_schema.sql results_views.sql

function flush_text() {
  if (text != "") print text "\n"
  text = ""
}

BEGIN {
  print "# Results schema\n"
  print "This page is generated from `analysis/results_schema.sql` and `results_views.sql`: `./dev docs`.\n"
}

/^-- / {
  text = text (text == "" ? "" : " ") substr($0, 4)
  next
}

/^$/ && !in_table {
  flush_text()
}

/^PRAGMA user_version/ {
  version = $0
  sub(/^[^=]*= */, "", version)
  sub(/;.*/, "", version)
  flush_text()
  print "Schema version " version "; definitions of the measures: `analysis/README.md`.\n"
}

/^CREATE TABLE/ {
  print "## " $3 "\n"
  flush_text()
  print "| column | type | may be NULL | meaning |\n|---|---|---|---|"
  in_table = 1
  next
}

/^CREATE VIEW/ {
  print "## " $3 " (view)\n"
  flush_text()
  if (/\($/) {
    print "| column | meaning |\n|---|---|"
    in_view = 1
  } else {
    print "Its columns: see the schema.\n"
  }
  next
}

in_view && /^\) AS/ {
  in_view = 0
  print ""
}

# One or several column names a line; a comment is the meaning of all of its line.
in_view {
  meaning = ""
  names = $0
  at = index($0, "-- ")
  if (at > 0) {
    meaning = substr($0, at + 3)
    names = substr($0, 1, at - 1)
  }
  gsub(/ /, "", names)
  count = split(names, name, ",")
  for (k = 1; k <= count; ++k) if (name[k] != "") print "| `" name[k] "` | " meaning " |"
}

in_table && /^\)/ {
  in_table = 0
  print ""
}

in_table && !/^ *PRIMARY KEY/ {
  meaning = ""
  definition = $0
  at = index($0, "-- ")
  if (at > 0) {
    meaning = substr($0, at + 3)
    definition = substr($0, 1, at - 1)
  }
  nullable = definition ~ /NOT NULL|PRIMARY KEY/ ? "" : "yes"
  if (definition ~ /CHECK \(/) {
    values = definition
    sub(/.* IN \(/, "", values)
    sub(/\).*/, "", values)
    gsub(/\047/, "", values)
    meaning = values (meaning == "" ? "" : ". " meaning)
  }
  type = $2
  sub(/,$/, "", type)
  print "| `" $1 "` | " type " | " nullable " | " meaning " |"
}
