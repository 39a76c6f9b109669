-- Functions of the plant's database: check the chain, store rows, separate the benches.
-- A bench signs in with its own role, which may call only the functions granted to it. They identify
-- the bench by that role, so that it can add only its own rows. {mirrored} stands for the names of
-- the tables whose rows are noted as a bench has them.

CREATE FUNCTION plant.my_bench() RETURNS TABLE(
  bench_key integer, name text, plant text, folders text, first_sha256 text,
  head_sequence bigint, head_sha256 text)
LANGUAGE sql SECURITY DEFINER SET search_path = plant, pg_temp AS $$
  SELECT b.bench_key, b.name,
    (SELECT content FROM plant.settings WHERE settings.name = 'identity'),
    (SELECT content FROM plant.settings WHERE settings.name = 'folders'),
    b.first_sha256, b.head_sequence, b.head_sha256
  FROM plant.benches b WHERE b.role = session_user AND b.replaced_by IS NULL
$$;

-- The covered content of a link, laid out as in `records.chain.Link.expected_sha256`.
CREATE FUNCTION plant.expected_sha256(link plant.links) RETURNS text
LANGUAGE sql IMMUTABLE AS $$
  SELECT encode(sha256(convert_to(
    '[' || link.sequence || ',' || to_json(link."table") || ',' || link.key || ','
    || to_json(link.recorded) || ',' || to_json(link.content) || ','
    || to_json(link.previous_sha256) || ']', 'UTF8')), 'hex')
$$;

CREATE FUNCTION plant.as_json(content text) RETURNS jsonb
LANGUAGE sql IMMUTABLE AS $$
  SELECT CASE WHEN position('\u0000' IN content) = 0 THEN content::jsonb
    ELSE regexp_replace(content, '(?<!\\)((\\\\)*)\\u0000', '\1\\ufffd', 'g')::jsonb END
$$;

-- A sealed folder is identified by its manifest's hash, whichever bench's registry has the run.
CREATE FUNCTION plant.mark_withdrawn(bench integer, after bigint) RETURNS void
LANGUAGE plpgsql SET search_path = plant, pg_temp AS $$
DECLARE
  said record;
BEGIN
  FOR said IN
    SELECT w.* FROM plant.links l
      JOIN plant.runs r ON r.bench_key = bench AND r.end_id = l.key
      JOIN plant.withdrawals w ON w.manifest_sha256 = r.manifest_sha256
    WHERE l.bench_key = bench AND l.sequence > after AND l."table" = 'run_ends'
    UNION
    SELECT w.* FROM plant.links l
      JOIN plant.amendments a ON a.bench_key = bench AND a.id = l.key AND a.subject = 'run_ends'
      JOIN plant.runs r ON r.bench_key = bench AND r.end_id = a.subject_key
      JOIN plant.withdrawals w ON w.bench_key = bench AND w.run_id = r.run_id
    WHERE l.bench_key = bench AND l.sequence > after AND l."table" = 'amendments'
  LOOP
    UPDATE plant.runs r SET withdrawn = said.withdrawn, withdrawn_by = said.withdrawn_by,
        withdrawn_reason = said.reason
      WHERE r.withdrawn IS NULL AND r.manifest_sha256 = said.manifest_sha256;
  END LOOP;
END $$;

CREATE FUNCTION plant.note_rows(bench integer, after bigint) RETURNS void
LANGUAGE plpgsql SET search_path = plant, pg_temp AS $$
DECLARE
  source text;
  sources text[];
  known record;
BEGIN
  SELECT array_agg(DISTINCT l."table") INTO sources FROM plant.links l
    WHERE l.bench_key = bench AND l.sequence > after;
  FOREACH source IN ARRAY coalesce(sources, '{}') LOOP
    IF source = ANY({mirrored}) THEN
      EXECUTE format('INSERT INTO plant.%1$I SELECT row_of.* FROM plant.links l, '
        'LATERAL jsonb_populate_record(NULL::plant.%1$I, plant.as_json(l.content) '
        '|| jsonb_build_object(''bench_key'', l.bench_key)) AS row_of '
        'WHERE l.bench_key = $1 AND l.sequence > $2 AND l."table" = %1$L', source)
        USING bench, after;
    END IF;
  END LOOP;
  WITH begun AS (
    SELECT each.* FROM plant.links l, LATERAL jsonb_to_record(plant.as_json(l.content)) AS each(
      id bigint, run_id text, kind text, started timestamptz, side text, operator text,
      simulated boolean, profile_name text, profile_sha256 text, software_version text)
    WHERE l.bench_key = bench AND l.sequence > after AND l."table" = 'runs'),
  ended AS (
    SELECT each.* FROM plant.links l, LATERAL jsonb_to_record(plant.as_json(l.content)) AS each(
      id bigint, run_key bigint, finished timestamptz, status text, reason text,
      manifest_sha256 text)
    WHERE l.bench_key = bench AND l.sequence > after AND l."table" = 'run_ends'),
  added AS (
    INSERT INTO plant.runs (bench_key, id, run_id, kind, started, side, operator, simulated,
        profile_name, profile_sha256, software_version, end_id, finished, status, reason,
        manifest_sha256)
      SELECT bench, begun.*, ended.id, ended.finished, coalesce(ended.status, 'running'),
        coalesce(ended.reason, ''), ended.manifest_sha256
      FROM begun LEFT JOIN ended ON ended.run_key = begun.id)
  UPDATE plant.runs r SET end_id = ended.id, finished = ended.finished, status = ended.status,
      reason = ended.reason, manifest_sha256 = ended.manifest_sha256
    FROM ended WHERE r.bench_key = bench AND r.id = ended.run_key;
  -- A run that its bench has discarded is withdrawn wherever the same sealed folder is known.
  INSERT INTO plant.withdrawals (bench_key, run_id, manifest_sha256, withdrawn, withdrawn_by,
      reason)
    SELECT bench, r.run_id, r.manifest_sha256, each.amended, each.amended_by, each.reason
    FROM plant.links l, LATERAL jsonb_to_record(plant.as_json(l.content)) AS each(
      subject text, subject_key bigint, amended timestamptz, amended_by text, reason text,
      changes jsonb), plant.runs r
    WHERE l.bench_key = bench AND l.sequence > after AND l."table" = 'amendments'
      AND each.subject = 'run_ends' AND each.changes ->> 'status' = 'discarded'
      AND r.bench_key = bench AND r.end_id = each.subject_key;
  IF sources && ARRAY['run_ends', 'amendments'] THEN
    PERFORM plant.mark_withdrawn(bench, after);
  END IF;
  IF 'equipment_descriptions' = ANY(sources) THEN
    FOR known IN
      INSERT INTO plant.batches (serial, batch, recorded)
        SELECT DISTINCT ON (e.serial) e.serial, d.details ->> 'batch', d.recorded
        FROM plant.links l
        JOIN plant.equipment_descriptions d ON d.bench_key = bench AND d.id = l.key
        JOIN plant.equipment e ON e.bench_key = bench AND e.id = d.equipment_key
        WHERE l.bench_key = bench AND l.sequence > after AND l."table" = 'equipment_descriptions'
          AND e.kind = 'reducer' AND d.details ? 'batch'
        ORDER BY e.serial, d.recorded DESC
      ON CONFLICT (serial) DO UPDATE SET batch = excluded.batch, recorded = excluded.recorded
        WHERE excluded.recorded > plant.batches.recorded
      RETURNING serial, batch
    LOOP
      UPDATE plant.runs r SET batch = known.batch
        WHERE r.serial = known.serial AND r.batch <> known.batch;
    END LOOP;
  END IF;
END $$;

CREATE FUNCTION plant.append(links json) RETURNS TABLE(sequence bigint, sha256 text)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = plant, pg_temp AS $$
#variable_conflict use_column
DECLARE
  mine plant.benches;
  wrong record;
  first_new bigint;
BEGIN
  SELECT * INTO mine FROM plant.benches b
    WHERE b.role = session_user AND b.replaced_by IS NULL FOR UPDATE;
  IF NOT FOUND THEN
    RAISE EXCEPTION '% is no bench of this plant', session_user USING ERRCODE = 'TB001';
  END IF;
  -- What is known already is left out: sending it again changes nothing.
  INSERT INTO plant.links
    SELECT mine.bench_key, each.* FROM json_to_recordset(append.links) AS each(
      sequence bigint, "table" text, key bigint, recorded text, content text,
      previous_sha256 text, sha256 text)
    WHERE each.sequence > mine.head_sequence;
  SELECT checked.sequence, checked."table", checked.key INTO wrong FROM (
    SELECT l.sequence, l."table", l.key,
      l.sequence = lag(l.sequence, 1, mine.head_sequence) OVER ordered + 1
      AND l.previous_sha256 = lag(l.sha256, 1, mine.head_sha256) OVER ordered
      AND l.sha256 = plant.expected_sha256(l) AS holds
    FROM plant.links l
    WHERE l.bench_key = mine.bench_key AND l.sequence > mine.head_sequence
    WINDOW ordered AS (ORDER BY l.sequence)) AS checked
  WHERE NOT checked.holds ORDER BY checked.sequence LIMIT 1;
  IF FOUND THEN
    RAISE EXCEPTION 'entry % (% %) doesn''t continue the chain that the plant has up to entry %',
      wrong.sequence, wrong."table", wrong.key, mine.head_sequence USING ERRCODE = 'TB002';
  END IF;
  PERFORM plant.note_rows(mine.bench_key, mine.head_sequence);
  UPDATE plant.benches b SET
    head_sequence = last.sequence, head_sha256 = last.sha256, last_contact = now(),
    first_sha256 = coalesce(b.first_sha256, (
      SELECT l.sha256 FROM plant.links l WHERE l.bench_key = mine.bench_key AND l.sequence = 1))
  FROM (SELECT mine.head_sequence AS sequence, mine.head_sha256 AS sha256
    UNION ALL (SELECT l.sequence, l.sha256 FROM plant.links l
      WHERE l.bench_key = mine.bench_key AND l.sequence > mine.head_sequence)
    ORDER BY 1 DESC LIMIT 1) AS last
  WHERE b.bench_key = mine.bench_key;
  RETURN QUERY SELECT b.head_sequence, b.head_sha256 FROM plant.benches b
    WHERE b.bench_key = mine.bench_key;
END $$;

CREATE FUNCTION plant.withdraw(bench integer, run text, who text, why text) RETURNS integer
LANGUAGE plpgsql SET search_path = plant, pg_temp AS $$
DECLARE
  manifest text;
  marked integer;
BEGIN
  SELECT r.manifest_sha256 INTO STRICT manifest FROM plant.runs r
    WHERE r.bench_key = bench AND r.run_id = run;
  INSERT INTO plant.withdrawals (bench_key, run_id, manifest_sha256, withdrawn, withdrawn_by,
    reason) VALUES (bench, run, manifest, now(), who, why);
  UPDATE plant.runs r SET withdrawn = now(), withdrawn_by = who, withdrawn_reason = why
    WHERE r.withdrawn IS NULL AND ((r.bench_key = bench AND r.run_id = run)
      OR r.manifest_sha256 = manifest);
  GET DIAGNOSTICS marked = ROW_COUNT;
  RETURN marked;
END $$;

CREATE FUNCTION plant.my_withdrawals() RETURNS TABLE(run_id text, withdrawn_by text, reason text)
LANGUAGE sql SECURITY DEFINER SET search_path = plant, pg_temp AS $$
  SELECT r.run_id, r.withdrawn_by, r.withdrawn_reason FROM plant.runs r
    JOIN plant.my_bench() mine ON r.bench_key = mine.bench_key
  WHERE r.withdrawn IS NOT NULL AND NOT EXISTS (
    SELECT 1 FROM plant.amendments a WHERE a.bench_key = r.bench_key AND a.subject = 'run_ends'
      AND a.subject_key = r.end_id AND a.changes ->> 'status' = 'discarded')
  ORDER BY r.id
$$;

CREATE FUNCTION plant.my_missing_folders(most integer) RETURNS TABLE(
  run_id text, manifest_sha256 text)
LANGUAGE sql SECURITY DEFINER SET search_path = plant, pg_temp AS $$
  SELECT r.run_id, r.manifest_sha256 FROM plant.runs r
    JOIN plant.my_bench() mine ON r.bench_key = mine.bench_key
  WHERE r.manifest_sha256 IS NOT NULL AND NOT EXISTS (
    SELECT 1 FROM plant.folders f WHERE f.bench_key = r.bench_key AND f.run_id = r.run_id)
  ORDER BY r.id LIMIT most
$$;

CREATE FUNCTION plant.arrived(pushed json) RETURNS bigint
LANGUAGE plpgsql SECURITY DEFINER SET search_path = plant, pg_temp AS $$
DECLARE
  mine integer;
  root text;
  wrong text;
  added bigint;
BEGIN
  SELECT m.bench_key, rtrim(m.folders, '/') || '/' || m.bench_key || '-' INTO mine, root
    FROM plant.my_bench() m;
  IF mine IS NULL THEN
    RAISE EXCEPTION '% is no bench of this plant', session_user USING ERRCODE = 'TB001';
  END IF;
  SELECT each.run_id INTO wrong FROM json_to_recordset(pushed) AS each(
      run_id text, manifest_sha256 text, url text, points_url text)
    LEFT JOIN plant.runs r ON r.bench_key = mine AND r.run_id = each.run_id
      AND r.manifest_sha256 = each.manifest_sha256
    WHERE r.id IS NULL LIMIT 1;
  IF FOUND THEN
    RAISE EXCEPTION 'run % with this manifest isn''t in the chain of %', wrong, session_user
      USING ERRCODE = 'TB003';
  END IF;
  SELECT each.url INTO wrong FROM json_to_recordset(pushed) AS each(url text, points_url text)
    WHERE NOT starts_with(each.url, root) OR NOT starts_with(coalesce(each.points_url, root), root)
      OR '..' = ANY(string_to_array(each.url, '/') || string_to_array(each.points_url, '/'))
    LIMIT 1;
  IF FOUND THEN
    RAISE EXCEPTION 'folder % lies outside those of bench %', wrong, mine USING ERRCODE = 'TB003';
  END IF;
  -- One statement: a temporary table could be the bench's own, with a trigger that would act with
  -- the rights of this function's owner.
  WITH noted AS (
    INSERT INTO plant.folders
      SELECT mine, each.run_id, each.manifest_sha256, each.url, each.points_url, each.bytes,
        each.left_out, now()
      FROM json_to_recordset(pushed) AS each(run_id text, manifest_sha256 text, url text,
        points_url text, bytes bigint, left_out text[]) ON CONFLICT DO NOTHING
      RETURNING folders.run_id),
  arriving AS (
    SELECT each.run_id, each.facts
      FROM json_to_recordset(pushed) AS each(run_id text, facts json) JOIN noted USING (run_id)),
  described AS (
    UPDATE plant.runs r SET specimen_type = coalesce(a.facts ->> 'specimen_type', ''),
        serial = coalesce(a.facts ->> 'serial', ''),
        batch = coalesce((SELECT b.batch FROM plant.batches b
          WHERE b.serial = a.facts ->> 'serial'), '')
      FROM arriving a WHERE r.bench_key = mine AND r.run_id = a.run_id
        AND a.facts ->> 'specimen_type' <> ''),
  resulting AS (
    INSERT INTO plant.results
      SELECT mine, a.run_id, each.* FROM arriving a, LATERAL
        json_to_recordset(a.facts -> 'quantities') AS each(
          quantity text, title text, value double precision, expanded_uncertainty double precision,
          unit text, "limit" text, verdict text))
  SELECT count(*) INTO added FROM noted;
  RETURN added;
END $$;

CREATE FUNCTION plant.no_changes() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  RAISE EXCEPTION 'rows of % are never changed or removed', TG_TABLE_NAME;
END $$;
