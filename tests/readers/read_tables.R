# Opens the table of carved with read.csv, without options, and compares what it finds.
#
#     Rscript read_tables.R FOLDER      with table.csv, shape.csv and expected.csv: column, kind, value of the first row

folder <- commandArgs(trailingOnly = TRUE)[1]
table <- read.csv(file.path(folder, "table.csv"))
expected <- read.csv(file.path(folder, "expected.csv"), colClasses = "character")
for (i in seq_len(nrow(expected))) {
  name <- expected$column[i]
  stopifnot(name %in% names(table))
  column <- table[[name]]
  kind <- if (is.logical(column)) "truth" else if (is.numeric(column)) "number" else "text"
  if (kind != expected$kind[i]) stop(paste(name, "is", kind, "not", expected$kind[i]))
  first <- column[1]
  wanted <- expected$value[i]
  same <- switch(kind, truth = first == as.logical(wanted), number = first == as.numeric(wanted), text = first == wanted)
  if (!isTRUE(same)) stop(paste(name, "is", first, "not", wanted))
}
shape <- read.csv(file.path(folder, "shape.csv"))
stopifnot(nrow(shape) > 0, is.numeric(shape$area_um2))
cat("read\n")
