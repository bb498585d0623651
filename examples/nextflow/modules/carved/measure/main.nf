process CARVED_MEASURE {
    tag "${meta.id}"
    label 'process_medium'

    // From the tarball of `make offline`, as examples/biomero/Dockerfile builds it.
    container "carved:0.1.0"

    input:
    tuple val(meta), path(runs, stageAs: 'runs/*')
    path method

    output:
    tuple val(meta), path("${prefix}_measurements"), emit: measurements
    tuple val(meta), path("${prefix}.csv"), emit: table
    tuple val("${task.process}"), val('carved'), eval("carved --version | cut -d ' ' -f 2"), topic: versions, emit: versions_carved

    when:
    task.ext.when == null || task.ext.when

    script:
    if (workflow.profile.tokenize(',').intersect(['conda', 'mamba']).size() >= 1) {
        error("CARVED_MEASURE: carved has no Conda package. Use Docker, Singularity or Apptainer, or a carved on the path.")
    }
    def args = task.ext.args ?: ''
    def with_method = method ? "--method ${method}" : ''
    prefix = task.ext.prefix ?: "${meta.id}"
    """
    carved measure \\
        --out ${prefix}_measurements \\
        --jobs ${task.cpus} \\
        ${with_method} \\
        ${args} \\
        ${runs} || [ \$? -eq 3 ]

    carved export table \\
        ${runs} \\
        --measurements ${prefix}_measurements \\
        --out ${prefix}.csv
    """

    stub:
    prefix = task.ext.prefix ?: "${meta.id}"
    """
    mkdir ${prefix}_measurements
    touch ${prefix}.csv
    """
}
