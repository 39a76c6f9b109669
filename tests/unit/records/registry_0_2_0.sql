BEGIN TRANSACTION;
CREATE TABLE activations (
	id INTEGER NOT NULL, 
	transducer_key INTEGER NOT NULL, 
	counter_key INTEGER NOT NULL, 
	model_key INTEGER, 
	activated DATETIME NOT NULL, 
	operator TEXT NOT NULL, 
	reason TEXT NOT NULL, 
	CONSTRAINT pk_activations PRIMARY KEY (id), 
	CONSTRAINT fk_activations_transducer_key FOREIGN KEY(transducer_key) REFERENCES equipment (id), 
	CONSTRAINT fk_activations_counter_key FOREIGN KEY(counter_key) REFERENCES equipment (id), 
	CONSTRAINT fk_activations_model_key FOREIGN KEY(model_key) REFERENCES models (id)
);
INSERT INTO "activations" VALUES(1,1,5,1,'2026-11-27 09:31:40.385915','Li','although its calibration contradicts itself: looked at it');
INSERT INTO "activations" VALUES(2,1,5,NULL,'2026-11-27 09:31:40.403677','Li','repair');
CREATE TABLE adjustments (
	id INTEGER NOT NULL, 
	equipment_key INTEGER NOT NULL, 
	what TEXT NOT NULL, 
	"before" JSON NOT NULL, 
	"after" JSON NOT NULL, 
	performed DATETIME NOT NULL, 
	performed_by TEXT NOT NULL, 
	checked_by TEXT NOT NULL, 
	reason TEXT NOT NULL, 
	CONSTRAINT pk_adjustments PRIMARY KEY (id), 
	CONSTRAINT fk_adjustments_equipment_key FOREIGN KEY(equipment_key) REFERENCES equipment (id)
);
INSERT INTO "adjustments" VALUES(1,1,'span set','{"span": 1.0}','{"span": 0.995}','2025-03-04 05:06:07.891234','Kim','Li','drift');
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0003');
CREATE TABLE amendments (
	id INTEGER NOT NULL, 
	subject TEXT NOT NULL, 
	subject_key INTEGER NOT NULL, 
	amended DATETIME NOT NULL, 
	amended_by TEXT NOT NULL, 
	reason TEXT NOT NULL, 
	changes JSON NOT NULL, 
	CONSTRAINT pk_amendments PRIMARY KEY (id)
);
INSERT INTO "amendments" VALUES(1,'calibrations',1,'2026-11-27 09:31:40.448619','Li','misspelt','{"measured_by": "K. Kim"}');
INSERT INTO "amendments" VALUES(2,'registry',0,'2026-11-27 09:31:40.458610','Kim','completed from run folders','{"runs": ["run-1"]}');
CREATE TABLE audit_ends (
	id INTEGER NOT NULL, 
	log TEXT NOT NULL, 
	line INTEGER NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	recorded DATETIME NOT NULL, 
	CONSTRAINT pk_audit_ends PRIMARY KEY (id)
);
INSERT INTO "audit_ends" VALUES(1,'audit',12,'3434343434343434343434343434343434343434343434343434343434343434','2026-11-27 09:31:40.470394');
CREATE TABLE calibrations (
	id INTEGER NOT NULL, 
	run_key INTEGER, 
	transducer_key INTEGER NOT NULL, 
	counter_key INTEGER NOT NULL, 
	standard_key INTEGER, 
	performed DATETIME NOT NULL, 
	measured_by TEXT NOT NULL, 
	range_nm DOUBLE NOT NULL, 
	valid_low_nm DOUBLE NOT NULL, 
	valid_high_nm DOUBLE NOT NULL, 
	due DATE, 
	points INTEGER NOT NULL, 
	data_sha256 VARCHAR(64) NOT NULL, 
	profile_name TEXT NOT NULL, 
	profile_sha256 VARCHAR(64) NOT NULL, 
	simulated BOOLEAN NOT NULL, 
	files JSON NOT NULL, 
	summary JSON NOT NULL, 
	CONSTRAINT pk_calibrations PRIMARY KEY (id), 
	CONSTRAINT fk_calibrations_run_key FOREIGN KEY(run_key) REFERENCES runs (id), 
	CONSTRAINT fk_calibrations_transducer_key FOREIGN KEY(transducer_key) REFERENCES equipment (id), 
	CONSTRAINT fk_calibrations_counter_key FOREIGN KEY(counter_key) REFERENCES equipment (id), 
	CONSTRAINT fk_calibrations_standard_key FOREIGN KEY(standard_key) REFERENCES equipment (id)
);
INSERT INTO "calibrations" VALUES(1,1,1,5,3,'2025-03-04 05:06:07.891234','Kim',10.0,0.0,10.0,'2026-03-04',3,'ac11666023598ad31dc335096c01605b952ae77b626d575c662cb3645f471bed','rapid-in-situ','abababababababababababababababababababababababababababababababab',0,'{"manifest.json": "efefefefefefefefefefefefefefefefefefefefefefefefefefefefefefefef"}','{"unsettled points": 0, "placement": "3 points", "span_error_percent": {"clockwise": 1.6000000000000014}, "messages": {"3 points": {"template": "{count} points", "values": {"count": "3"}}}}');
CREATE TABLE certificates (
	id INTEGER NOT NULL, 
	number TEXT NOT NULL, 
	calibration_key INTEGER NOT NULL, 
	supersedes_key INTEGER, 
	issued DATETIME NOT NULL, 
	authorised_by TEXT NOT NULL, 
	files JSON NOT NULL, 
	summary JSON NOT NULL, 
	CONSTRAINT pk_certificates PRIMARY KEY (id), 
	CONSTRAINT uq_certificates_number UNIQUE (number), 
	CONSTRAINT fk_certificates_calibration_key FOREIGN KEY(calibration_key) REFERENCES calibrations (id), 
	CONSTRAINT fk_certificates_supersedes_key FOREIGN KEY(supersedes_key) REFERENCES certificates (id)
);
INSERT INTO "certificates" VALUES(1,'TB-1',1,NULL,'2025-03-04 05:06:07.891234','A. Boss','{"TB-1.xml": "5656565656565656565656565656565656565656565656565656565656565656"}','{"record_sha256": "7878787878787878787878787878787878787878787878787878787878787878", "archive": "certificates/TB-1"}');
INSERT INTO "certificates" VALUES(2,'TB-1-2',1,1,'2025-03-05 05:06:07.891234','A. Boss','{"TB-1-2.xml": "5757575757575757575757575757575757575757575757575757575757575757"}','{"record_sha256": "7979797979797979797979797979797979797979797979797979797979797979", "archive": "certificates/TB-1-2"}');
CREATE TABLE chain (
	sequence INTEGER NOT NULL, 
	"table" TEXT NOT NULL, 
	"key" INTEGER NOT NULL, 
	recorded TEXT NOT NULL, 
	content TEXT NOT NULL, 
	previous_sha256 VARCHAR(64) NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	CONSTRAINT pk_chain PRIMARY KEY (sequence), 
	CONSTRAINT uq_chain_sha256 UNIQUE (sha256)
);
INSERT INTO "chain" VALUES(1,'equipment',1,'2026-11-27T09:31:40.256095+00:00','{"id":1,"kind":"transducer","recorded":"2026-11-27T09:31:40.253620+00:00","serial":"T-1"}','0000000000000000000000000000000000000000000000000000000000000000','b8091e088f3773da89f1e179658521c7a4582921fd52c24d84bdc1823a046d9a');
INSERT INTO "chain" VALUES(2,'equipment_descriptions',1,'2026-11-27T09:31:40.256095+00:00','{"details":{"class":0.1,"zero_hz":60000.0},"equipment_key":1,"id":1,"manufacturer":"HBK","model":"T40B","range_nm":50.0,"recorded":"2026-11-27T09:31:40.252345+00:00"}','b8091e088f3773da89f1e179658521c7a4582921fd52c24d84bdc1823a046d9a','373b34daa90b809846c6fa6c8c839b2ca9793b4653813b880cfd4b726870c38d');
INSERT INTO "chain" VALUES(3,'equipment',2,'2026-11-27T09:31:40.265301+00:00','{"id":2,"kind":"bench","recorded":"2026-11-27T09:31:40.263044+00:00","serial":"Prüfstand 4"}','373b34daa90b809846c6fa6c8c839b2ca9793b4653813b880cfd4b726870c38d','bc678d5a3f8845dd2096bd729c5c6c77f47dc231e377c7933bc55afa817820da');
INSERT INTO "chain" VALUES(4,'equipment_descriptions',2,'2026-11-27T09:31:40.265301+00:00','{"details":{},"equipment_key":2,"id":2,"manufacturer":"","model":"","range_nm":null,"recorded":"2026-11-27T09:31:40.262638+00:00"}','bc678d5a3f8845dd2096bd729c5c6c77f47dc231e377c7933bc55afa817820da','2578b873df98c4cadeba7c499772f087e9276b368d0b44ec63a964c5d5aacadb');
INSERT INTO "chain" VALUES(5,'components',1,'2026-11-27T09:31:40.269949+00:00','{"change":"fitted","id":1,"part_key":1,"performed":"2026-11-27T09:31:40.268189+00:00","performed_by":"Kim","reason":"neu","role":"input.transducer","whole_key":2}','2578b873df98c4cadeba7c499772f087e9276b368d0b44ec63a964c5d5aacadb','bd31c643c286bd9cd31ac4850214583ea3a32d00f0e8280013aca9e902c1a021');
INSERT INTO "chain" VALUES(6,'adjustments',1,'2026-11-27T09:31:40.277409+00:00','{"after":{"span":0.995},"before":{"span":1.0},"checked_by":"Li","equipment_key":1,"id":1,"performed":"2025-03-04T05:06:07.891234+00:00","performed_by":"Kim","reason":"drift","what":"span set"}','bd31c643c286bd9cd31ac4850214583ea3a32d00f0e8280013aca9e902c1a021','b334fb9c821e8d2b0223e4ea2f69e0d3038cc33cb6f963dbd51dcaedbf067c79');
INSERT INTO "chain" VALUES(7,'equipment',3,'2026-11-27T09:31:40.281852+00:00','{"id":3,"kind":"calibrator","recorded":"2026-11-27T09:31:40.279671+00:00","serial":"R-9"}','b334fb9c821e8d2b0223e4ea2f69e0d3038cc33cb6f963dbd51dcaedbf067c79','4b505eaee8dc8b1c9da53913f33cd10adae7857795081a2bafe095799ba812b0');
INSERT INTO "chain" VALUES(8,'reports',1,'2026-11-27T09:31:40.281852+00:00','{"checked_by":"Li","due":"2026-01-31","equipment_key":3,"expanded_uncertainty_percent":0.02,"file":"k78.txt","file_sha256":"66e21033900e4dde60171fe68063d0bee1d2f00cc9b87452fa54e9458ba4e060","id":1,"laboratory":"Labor","measured_by":"Kim","number":"K-78","performed":"2024-01-31","recorded":"2026-11-27T09:31:40.279300+00:00","valid_high_nm":50.0,"valid_low_nm":-50.0}','4b505eaee8dc8b1c9da53913f33cd10adae7857795081a2bafe095799ba812b0','ca132de64453eeb8f5a69f369e172d963cc4e3412bfddb50566f23a7fbd3392b');
INSERT INTO "chain" VALUES(9,'equipment',4,'2026-11-27T09:31:40.291031+00:00','{"id":4,"kind":"calibrator","recorded":"2026-11-27T09:31:40.290369+00:00","serial":"R-10"}','ca132de64453eeb8f5a69f369e172d963cc4e3412bfddb50566f23a7fbd3392b','90cc04d528bf968106c837b4a03466556793dfc04dc6faf5f52e5db14066bbdd');
INSERT INTO "chain" VALUES(10,'reports',2,'2026-11-27T09:31:40.291031+00:00','{"checked_by":"","due":null,"equipment_key":4,"expanded_uncertainty_percent":null,"file":"","file_sha256":"","id":2,"laboratory":"","measured_by":"","number":"K-79","performed":null,"recorded":"2026-11-27T09:31:40.289753+00:00","valid_high_nm":null,"valid_low_nm":null}','90cc04d528bf968106c837b4a03466556793dfc04dc6faf5f52e5db14066bbdd','c2681a89e3512d05e1a6b4ecffc08dc0e2539b4c52440998d9d5a4482f0396f5');
INSERT INTO "chain" VALUES(11,'runs',1,'2026-11-27T09:31:40.297550+00:00','{"bench":"Prüfstand 4","folder":"runs/run-1","id":1,"kind":"calibrate-input","operator":"Kim","profile_name":"rapid-in-situ","profile_sha256":"abababababababababababababababababababababababababababababababab","run_id":"run-1","side":"input","simulated":true,"software_version":"0.2.0","started":"2025-03-04T05:06:07.891234+00:00"}','c2681a89e3512d05e1a6b4ecffc08dc0e2539b4c52440998d9d5a4482f0396f5','d411e123692bf1028ac2b5976d64c3dc78dc288a4dee81408c46b8295606f1f5');
INSERT INTO "chain" VALUES(12,'runs',2,'2026-11-27T09:31:40.307280+00:00','{"bench":"","folder":"runs/run-2","id":2,"kind":"verify-input","operator":"","profile_name":"","profile_sha256":"","run_id":"run-2","side":"","simulated":false,"software_version":"0.2.0","started":"2025-03-04T06:06:07.891234+00:00"}','d411e123692bf1028ac2b5976d64c3dc78dc288a4dee81408c46b8295606f1f5','481bac232e58566da8d52f89e5954f349bcc44b6b061ae87d71f98971ab3949a');
INSERT INTO "chain" VALUES(13,'run_ends',1,'2026-11-27T09:31:40.307280+00:00','{"finished":"2025-03-04T07:06:07.891234+00:00","id":1,"manifest_sha256":"cdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcd","reason":"","run_key":2,"status":"completed"}','481bac232e58566da8d52f89e5954f349bcc44b6b061ae87d71f98971ab3949a','7880abe4e9753139027a7fc21a035375d40e3e1c5d8b4c26cc7eb56dbaf1c044');
INSERT INTO "chain" VALUES(14,'zeroings',1,'2026-11-27T09:31:40.324790+00:00','{"id":1,"performed":"2025-03-04T05:06:07.891234+00:00","run_key":1,"simulated":true,"temperature_c":23.1,"transducer_key":1,"zero_hz":60001.25,"zero_nm":0.00625}','7880abe4e9753139027a7fc21a035375d40e3e1c5d8b4c26cc7eb56dbaf1c044','b719aea3dbcd0b01e1dee8edb149373f34240a4a0c022b358f3333a42e699fe6');
INSERT INTO "chain" VALUES(15,'zeroings',2,'2026-11-27T09:31:40.329008+00:00','{"id":2,"performed":"2025-03-04T05:06:07.891234+00:00","run_key":null,"simulated":false,"temperature_c":null,"transducer_key":1,"zero_hz":60001.5,"zero_nm":0.0075}','b719aea3dbcd0b01e1dee8edb149373f34240a4a0c022b358f3333a42e699fe6','eadf3ba4d679e40cfacc01707b3fc79cc3336af654bc8141deb0b5d795ee0def');
INSERT INTO "chain" VALUES(16,'equipment',5,'2026-11-27T09:31:40.353584+00:00','{"id":5,"kind":"counter","recorded":"2026-11-27T09:31:40.348949+00:00","serial":"C-1"}','eadf3ba4d679e40cfacc01707b3fc79cc3336af654bc8141deb0b5d795ee0def','b4c71f839525effa08a43684d715f855ddd700e87c7e5b72f8678a3d7c5504a2');
INSERT INTO "chain" VALUES(17,'calibrations',1,'2026-11-27T09:31:40.353584+00:00','{"counter_key":5,"data_sha256":"ac11666023598ad31dc335096c01605b952ae77b626d575c662cb3645f471bed","due":"2026-03-04","files":{"manifest.json":"efefefefefefefefefefefefefefefefefefefefefefefefefefefefefefefef"},"id":1,"measured_by":"Kim","performed":"2025-03-04T05:06:07.891234+00:00","points":3,"profile_name":"rapid-in-situ","profile_sha256":"abababababababababababababababababababababababababababababababab","range_nm":10.0,"run_key":1,"simulated":false,"standard_key":3,"summary":{"messages":{"3 points":{"template":"{count} points","values":{"count":"3"}}},"placement":"3 points","span_error_percent":{"clockwise":1.6000000000000014},"unsettled points":0},"transducer_key":1,"valid_high_nm":10.0,"valid_low_nm":0.0}','b4c71f839525effa08a43684d715f855ddd700e87c7e5b72f8678a3d7c5504a2','5c0043d779e4d75b38c314cc8227dbc1e06b7788a433974034ee49ec93e91990');
INSERT INTO "chain" VALUES(18,'models',1,'2026-11-27T09:31:40.377865+00:00','{"calibration_key":1,"created":"2025-03-04T05:06:07.891234+00:00","file":"models/m.json","file_sha256":"44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a","id":1,"kind":"polynomial","metrics":{"contradictions":[{"allowed":"at most 0.06 %","cause":"Possible causes: a.","clause":"plausibility.split_percent","found":"split by 0.5 %","kind":"split"}],"messages":{"at most 0.06 %":{"template":"at most {x} %","values":{"x":"0.06"}},"split by 0.5 %":{"template":"split by {x} %","values":{"x":"0.5"}}},"rms_nm":0.25},"range_nm":10.0,"side":"input"}','5c0043d779e4d75b38c314cc8227dbc1e06b7788a433974034ee49ec93e91990','281e5f609d3384ef0d5666feb18d03476f4f18aa4d8ca0fb16c07294290101a1');
INSERT INTO "chain" VALUES(19,'activations',1,'2026-11-27T09:31:40.387049+00:00','{"activated":"2026-11-27T09:31:40.385915+00:00","counter_key":5,"id":1,"model_key":1,"operator":"Li","reason":"although its calibration contradicts itself: looked at it","transducer_key":1}','281e5f609d3384ef0d5666feb18d03476f4f18aa4d8ca0fb16c07294290101a1','6cf63cdfb4ff48fb191fda2e7023da04ea1398d8ec24576a80bf8f8e79510b29');
INSERT INTO "chain" VALUES(20,'activations',2,'2026-11-27T09:31:40.405290+00:00','{"activated":"2026-11-27T09:31:40.403677+00:00","counter_key":5,"id":2,"model_key":null,"operator":"Li","reason":"repair","transducer_key":1}','6cf63cdfb4ff48fb191fda2e7023da04ea1398d8ec24576a80bf8f8e79510b29','062dad8cdb2b5b3b556e23c3a470015da725847d42fd930b98f071ae2339eae4');
INSERT INTO "chain" VALUES(21,'verifications',1,'2026-11-27T09:31:40.416281+00:00','{"data_sha256":"1212121212121212121212121212121212121212121212121212121212121212","id":1,"measured_by":"Kim","model_key":1,"performed":"2025-03-04T05:06:07.891234+00:00","run_key":2,"simulated":false,"summary":{"models":[{"name":"raw"}],"points":4}}','062dad8cdb2b5b3b556e23c3a470015da725847d42fd930b98f071ae2339eae4','6efb9761b30f11118044c26a53ad9e834b2df70727db5675e3199477695867dc');
INSERT INTO "chain" VALUES(22,'equipment',6,'2026-11-27T09:31:40.422601+00:00','{"id":6,"kind":"verification-standard","recorded":"2026-11-27T09:31:40.421199+00:00","serial":"S-1"}','6efb9761b30f11118044c26a53ad9e834b2df70727db5675e3199477695867dc','9f8d95fded660f9856c1875ea653ba99c30ff97dc1f65095cb04bd08dec8d982');
INSERT INTO "chain" VALUES(23,'checks',1,'2026-11-27T09:31:40.422601+00:00','{"id":1,"measured_by":"Kim","model_key":1,"performed":"2025-03-04T05:06:07.891234+00:00","run_key":2,"simulated":true,"standard_key":6,"summary":{"worst":1},"tolerance_percent_fs":0.1,"transducer_key":1,"verdict":"pass","worst_percent_fs":0.03}','9f8d95fded660f9856c1875ea653ba99c30ff97dc1f65095cb04bd08dec8d982','62f9e00e18b3e8912f69b50f1e152ab01081de5c7068cd38979fdda88e51aedc');
INSERT INTO "chain" VALUES(24,'checks',2,'2026-11-27T09:31:40.432506+00:00','{"id":2,"measured_by":"","model_key":null,"performed":"2025-03-04T05:06:07.891234+00:00","run_key":null,"simulated":true,"standard_key":null,"summary":{},"tolerance_percent_fs":0.1,"transducer_key":1,"verdict":"fail","worst_percent_fs":0.3}','62f9e00e18b3e8912f69b50f1e152ab01081de5c7068cd38979fdda88e51aedc','24a45e6f06f6c74777d948aff6e48d690aac9d492bfdcb37f7cf52a5ccf47c2d');
INSERT INTO "chain" VALUES(25,'reviews',1,'2026-11-27T09:31:40.438838+00:00','{"accepted":true,"checked":"2026-11-27T09:31:40.438050+00:00","checked_by":"Li","id":1,"remark":"plots looked at","subject":"calibrations","subject_key":1}','24a45e6f06f6c74777d948aff6e48d690aac9d492bfdcb37f7cf52a5ccf47c2d','ebaef64aebee86570ecf333415564eb2dc9afa3aebf507f5da5074ac594cd290');
INSERT INTO "chain" VALUES(26,'amendments',1,'2026-11-27T09:31:40.455126+00:00','{"amended":"2026-11-27T09:31:40.448619+00:00","amended_by":"Li","changes":{"measured_by":"K. Kim"},"id":1,"reason":"misspelt","subject":"calibrations","subject_key":1}','ebaef64aebee86570ecf333415564eb2dc9afa3aebf507f5da5074ac594cd290','b5902b48fef4ed1bcee91cd427b294dbb833ff01c8828f03bf18042549e4b513');
INSERT INTO "chain" VALUES(27,'amendments',2,'2026-11-27T09:31:40.459420+00:00','{"amended":"2026-11-27T09:31:40.458610+00:00","amended_by":"Kim","changes":{"runs":["run-1"]},"id":2,"reason":"completed from run folders","subject":"registry","subject_key":0}','b5902b48fef4ed1bcee91cd427b294dbb833ff01c8828f03bf18042549e4b513','b7c42fb51eed4193225a0a03792f6def220a0d8f93f1e002ec9218c40df148b9');
INSERT INTO "chain" VALUES(28,'audit_ends',1,'2026-11-27T09:31:40.471712+00:00','{"id":1,"line":12,"log":"audit","recorded":"2026-11-27T09:31:40.470394+00:00","sha256":"3434343434343434343434343434343434343434343434343434343434343434"}','b7c42fb51eed4193225a0a03792f6def220a0d8f93f1e002ec9218c40df148b9','7ec7a75313815debd5851da98de43a2eef797c0c24fd7c4500a394fe9c660d79');
INSERT INTO "chain" VALUES(29,'certificates',1,'2026-11-27T09:31:40.483075+00:00','{"authorised_by":"A. Boss","calibration_key":1,"files":{"TB-1.xml":"5656565656565656565656565656565656565656565656565656565656565656"},"id":1,"issued":"2025-03-04T05:06:07.891234+00:00","number":"TB-1","summary":{"archive":"certificates/TB-1","record_sha256":"7878787878787878787878787878787878787878787878787878787878787878"},"supersedes_key":null}','7ec7a75313815debd5851da98de43a2eef797c0c24fd7c4500a394fe9c660d79','f5ed8b62144abbf1810e1bd43d7a0141805db05e8fd1c9ea56026312e762b845');
INSERT INTO "chain" VALUES(30,'certificates',2,'2026-11-27T09:31:40.487509+00:00','{"authorised_by":"A. Boss","calibration_key":1,"files":{"TB-1-2.xml":"5757575757575757575757575757575757575757575757575757575757575757"},"id":2,"issued":"2025-03-05T05:06:07.891234+00:00","number":"TB-1-2","summary":{"archive":"certificates/TB-1-2","record_sha256":"7979797979797979797979797979797979797979797979797979797979797979"},"supersedes_key":1}','f5ed8b62144abbf1810e1bd43d7a0141805db05e8fd1c9ea56026312e762b845','6aab1a32e6e6d5b2ad53004d28790928bed5d24e0b1a39e1a4577dc370f212c4');
CREATE TABLE checks (
	id INTEGER NOT NULL, 
	transducer_key INTEGER NOT NULL, 
	standard_key INTEGER, 
	model_key INTEGER, 
	run_key INTEGER, 
	performed DATETIME NOT NULL, 
	measured_by TEXT NOT NULL, 
	verdict TEXT NOT NULL, 
	worst_percent_fs DOUBLE NOT NULL, 
	tolerance_percent_fs DOUBLE NOT NULL, 
	simulated BOOLEAN NOT NULL, 
	summary JSON NOT NULL, 
	CONSTRAINT pk_checks PRIMARY KEY (id), 
	CONSTRAINT fk_checks_transducer_key FOREIGN KEY(transducer_key) REFERENCES equipment (id), 
	CONSTRAINT fk_checks_standard_key FOREIGN KEY(standard_key) REFERENCES equipment (id), 
	CONSTRAINT fk_checks_model_key FOREIGN KEY(model_key) REFERENCES models (id), 
	CONSTRAINT fk_checks_run_key FOREIGN KEY(run_key) REFERENCES runs (id)
);
INSERT INTO "checks" VALUES(1,1,6,1,2,'2025-03-04 05:06:07.891234','Kim','pass',0.03,0.1,1,'{"worst": 1}');
INSERT INTO "checks" VALUES(2,1,NULL,NULL,NULL,'2025-03-04 05:06:07.891234','','fail',0.3,0.1,1,'{}');
CREATE TABLE components (
	id INTEGER NOT NULL, 
	whole_key INTEGER NOT NULL, 
	part_key INTEGER NOT NULL, 
	role TEXT NOT NULL, 
	change TEXT NOT NULL, 
	performed DATETIME NOT NULL, 
	performed_by TEXT NOT NULL, 
	reason TEXT NOT NULL, 
	CONSTRAINT pk_components PRIMARY KEY (id), 
	CONSTRAINT fk_components_whole_key FOREIGN KEY(whole_key) REFERENCES equipment (id), 
	CONSTRAINT fk_components_part_key FOREIGN KEY(part_key) REFERENCES equipment (id)
);
INSERT INTO "components" VALUES(1,2,1,'input.transducer','fitted','2026-11-27 09:31:40.268189','Kim','neu');
CREATE TABLE equipment (
	id INTEGER NOT NULL, 
	kind TEXT NOT NULL, 
	serial TEXT NOT NULL, 
	recorded DATETIME NOT NULL, 
	CONSTRAINT pk_equipment PRIMARY KEY (id)
);
INSERT INTO "equipment" VALUES(1,'transducer','T-1','2026-11-27 09:31:40.253620');
INSERT INTO "equipment" VALUES(2,'bench','Prüfstand 4','2026-11-27 09:31:40.263044');
INSERT INTO "equipment" VALUES(3,'calibrator','R-9','2026-11-27 09:31:40.279671');
INSERT INTO "equipment" VALUES(4,'calibrator','R-10','2026-11-27 09:31:40.290369');
INSERT INTO "equipment" VALUES(5,'counter','C-1','2026-11-27 09:31:40.348949');
INSERT INTO "equipment" VALUES(6,'verification-standard','S-1','2026-11-27 09:31:40.421199');
CREATE TABLE equipment_descriptions (
	id INTEGER NOT NULL, 
	equipment_key INTEGER NOT NULL, 
	manufacturer TEXT NOT NULL, 
	model TEXT NOT NULL, 
	range_nm DOUBLE, 
	details JSON NOT NULL, 
	recorded DATETIME NOT NULL, 
	CONSTRAINT pk_equipment_descriptions PRIMARY KEY (id), 
	CONSTRAINT fk_equipment_descriptions_equipment_key FOREIGN KEY(equipment_key) REFERENCES equipment (id)
);
INSERT INTO "equipment_descriptions" VALUES(1,1,'HBK','T40B',50.0,'{"class": 0.1, "zero_hz": 60000.0}','2026-11-27 09:31:40.252345');
INSERT INTO "equipment_descriptions" VALUES(2,2,'','',NULL,'{}','2026-11-27 09:31:40.262638');
CREATE TABLE models (
	id INTEGER NOT NULL, 
	calibration_key INTEGER NOT NULL, 
	kind TEXT NOT NULL, 
	file TEXT NOT NULL, 
	file_sha256 VARCHAR(64) NOT NULL, 
	range_nm DOUBLE NOT NULL, 
	side TEXT NOT NULL, 
	metrics JSON NOT NULL, 
	created DATETIME NOT NULL, 
	CONSTRAINT pk_models PRIMARY KEY (id), 
	CONSTRAINT fk_models_calibration_key FOREIGN KEY(calibration_key) REFERENCES calibrations (id)
);
INSERT INTO "models" VALUES(1,1,'polynomial','models/m.json','44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a',10.0,'input','{"rms_nm": 0.25, "contradictions": [{"kind": "split", "clause": "plausibility.split_percent", "found": "split by 0.5 %", "allowed": "at most 0.06 %", "cause": "Possible causes: a."}], "messages": {"split by 0.5 %": {"template": "split by {x} %", "values": {"x": "0.5"}}, "at most 0.06 %": {"template": "at most {x} %", "values": {"x": "0.06"}}}}','2025-03-04 05:06:07.891234');
CREATE TABLE reports (
	id INTEGER NOT NULL, 
	equipment_key INTEGER NOT NULL, 
	number TEXT NOT NULL, 
	laboratory TEXT NOT NULL, 
	performed DATE, 
	due DATE, 
	measured_by TEXT NOT NULL, 
	checked_by TEXT NOT NULL, 
	valid_low_nm DOUBLE, 
	valid_high_nm DOUBLE, 
	expanded_uncertainty_percent DOUBLE, 
	file TEXT NOT NULL, 
	file_sha256 VARCHAR(64) NOT NULL, 
	recorded DATETIME NOT NULL, 
	CONSTRAINT pk_reports PRIMARY KEY (id), 
	CONSTRAINT fk_reports_equipment_key FOREIGN KEY(equipment_key) REFERENCES equipment (id)
);
INSERT INTO "reports" VALUES(1,3,'K-78','Labor','2024-01-31','2026-01-31','Kim','Li',-50.0,50.0,0.02,'k78.txt','66e21033900e4dde60171fe68063d0bee1d2f00cc9b87452fa54e9458ba4e060','2026-11-27 09:31:40.279300');
INSERT INTO "reports" VALUES(2,4,'K-79','',NULL,NULL,'','',NULL,NULL,NULL,'','','2026-11-27 09:31:40.289753');
CREATE TABLE reviews (
	id INTEGER NOT NULL, 
	subject TEXT NOT NULL, 
	subject_key INTEGER NOT NULL, 
	checked DATETIME NOT NULL, 
	checked_by TEXT NOT NULL, 
	accepted BOOLEAN NOT NULL, 
	remark TEXT NOT NULL, 
	CONSTRAINT pk_reviews PRIMARY KEY (id)
);
INSERT INTO "reviews" VALUES(1,'calibrations',1,'2026-11-27 09:31:40.438050','Li',1,'plots looked at');
CREATE TABLE run_ends (
	id INTEGER NOT NULL, 
	run_key INTEGER NOT NULL, 
	finished DATETIME NOT NULL, 
	status TEXT NOT NULL, 
	reason TEXT NOT NULL, 
	manifest_sha256 VARCHAR(64) NOT NULL, 
	CONSTRAINT pk_run_ends PRIMARY KEY (id), 
	CONSTRAINT uq_run_ends_run_key UNIQUE (run_key), 
	CONSTRAINT fk_run_ends_run_key FOREIGN KEY(run_key) REFERENCES runs (id)
);
INSERT INTO "run_ends" VALUES(1,2,'2025-03-04 07:06:07.891234','completed','','cdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcd');
CREATE TABLE runs (
	id INTEGER NOT NULL, 
	run_id TEXT NOT NULL, 
	kind TEXT NOT NULL, 
	started DATETIME NOT NULL, 
	side TEXT NOT NULL, 
	operator TEXT NOT NULL, 
	bench TEXT NOT NULL, 
	simulated BOOLEAN NOT NULL, 
	profile_name TEXT NOT NULL, 
	profile_sha256 VARCHAR(64) NOT NULL, 
	software_version TEXT NOT NULL, 
	folder TEXT NOT NULL, 
	CONSTRAINT pk_runs PRIMARY KEY (id), 
	CONSTRAINT uq_runs_run_id UNIQUE (run_id)
);
INSERT INTO "runs" VALUES(1,'run-1','calibrate-input','2025-03-04 05:06:07.891234','input','Kim','Prüfstand 4',1,'rapid-in-situ','abababababababababababababababababababababababababababababababab','0.2.0','runs/run-1');
INSERT INTO "runs" VALUES(2,'run-2','verify-input','2025-03-04 06:06:07.891234','','','',0,'','','0.2.0','runs/run-2');
CREATE TABLE verifications (
	id INTEGER NOT NULL, 
	model_key INTEGER NOT NULL, 
	run_key INTEGER, 
	performed DATETIME NOT NULL, 
	measured_by TEXT NOT NULL, 
	data_sha256 VARCHAR(64) NOT NULL, 
	simulated BOOLEAN NOT NULL, 
	summary JSON NOT NULL, 
	CONSTRAINT pk_verifications PRIMARY KEY (id), 
	CONSTRAINT fk_verifications_model_key FOREIGN KEY(model_key) REFERENCES models (id), 
	CONSTRAINT fk_verifications_run_key FOREIGN KEY(run_key) REFERENCES runs (id)
);
INSERT INTO "verifications" VALUES(1,1,2,'2025-03-04 05:06:07.891234','Kim','1212121212121212121212121212121212121212121212121212121212121212',0,'{"points": 4, "models": [{"name": "raw"}]}');
CREATE TABLE zeroings (
	id INTEGER NOT NULL, 
	transducer_key INTEGER NOT NULL, 
	run_key INTEGER, 
	performed DATETIME NOT NULL, 
	zero_hz DOUBLE NOT NULL, 
	zero_nm DOUBLE NOT NULL, 
	temperature_c DOUBLE, 
	simulated BOOLEAN NOT NULL, 
	CONSTRAINT pk_zeroings PRIMARY KEY (id), 
	CONSTRAINT fk_zeroings_transducer_key FOREIGN KEY(transducer_key) REFERENCES equipment (id), 
	CONSTRAINT fk_zeroings_run_key FOREIGN KEY(run_key) REFERENCES runs (id)
);
INSERT INTO "zeroings" VALUES(1,1,1,'2025-03-04 05:06:07.891234',60001.25,0.00625,23.1,1);
INSERT INTO "zeroings" VALUES(2,1,NULL,'2025-03-04 05:06:07.891234',60001.5,0.0075,NULL,0);
CREATE UNIQUE INDEX ix_chain_row ON chain ("table", "key");
CREATE UNIQUE INDEX ix_equipment_identity ON equipment (kind, serial);
CREATE INDEX ix_runs_started ON runs (started, id);
CREATE INDEX ix_runs_kind_started ON runs (kind, started, id);
CREATE INDEX ix_reviews_subject ON reviews (subject, subject_key);
CREATE INDEX ix_amendments_subject ON amendments (subject, subject_key);
CREATE INDEX ix_equipment_descriptions_equipment_key ON equipment_descriptions (equipment_key);
CREATE INDEX ix_components_whole_key ON components (whole_key);
CREATE INDEX ix_components_part_key ON components (part_key);
CREATE INDEX ix_adjustments_equipment_key ON adjustments (equipment_key);
CREATE INDEX ix_reports_equipment_key ON reports (equipment_key);
CREATE INDEX ix_zeroings_transducer ON zeroings (transducer_key, performed);
CREATE INDEX ix_calibrations_transducer_key ON calibrations (transducer_key);
CREATE INDEX ix_models_calibration_key ON models (calibration_key);
CREATE INDEX ix_certificates_calibration_key ON certificates (calibration_key);
CREATE INDEX ix_activations_chain ON activations (transducer_key, counter_key, id);
CREATE INDEX ix_verifications_model_key ON verifications (model_key);
CREATE INDEX ix_checks_transducer ON checks (transducer_key, performed);
CREATE TRIGGER keep_amendments_update BEFORE UPDATE ON amendments BEGIN SELECT RAISE(ABORT, 'amendments is append-only: amend the record instead'); END;
CREATE TRIGGER keep_amendments_delete BEFORE DELETE ON amendments BEGIN SELECT RAISE(ABORT, 'amendments is append-only: amend the record instead'); END;
CREATE TRIGGER keep_audit_ends_update BEFORE UPDATE ON audit_ends BEGIN SELECT RAISE(ABORT, 'audit_ends is append-only: amend the record instead'); END;
CREATE TRIGGER keep_audit_ends_delete BEFORE DELETE ON audit_ends BEGIN SELECT RAISE(ABORT, 'audit_ends is append-only: amend the record instead'); END;
CREATE TRIGGER keep_chain_update BEFORE UPDATE ON chain BEGIN SELECT RAISE(ABORT, 'chain is append-only: amend the record instead'); END;
CREATE TRIGGER keep_chain_delete BEFORE DELETE ON chain BEGIN SELECT RAISE(ABORT, 'chain is append-only: amend the record instead'); END;
CREATE TRIGGER keep_equipment_update BEFORE UPDATE ON equipment BEGIN SELECT RAISE(ABORT, 'equipment is append-only: amend the record instead'); END;
CREATE TRIGGER keep_equipment_delete BEFORE DELETE ON equipment BEGIN SELECT RAISE(ABORT, 'equipment is append-only: amend the record instead'); END;
CREATE TRIGGER keep_reviews_update BEFORE UPDATE ON reviews BEGIN SELECT RAISE(ABORT, 'reviews is append-only: amend the record instead'); END;
CREATE TRIGGER keep_reviews_delete BEFORE DELETE ON reviews BEGIN SELECT RAISE(ABORT, 'reviews is append-only: amend the record instead'); END;
CREATE TRIGGER keep_runs_update BEFORE UPDATE ON runs BEGIN SELECT RAISE(ABORT, 'runs is append-only: amend the record instead'); END;
CREATE TRIGGER keep_runs_delete BEFORE DELETE ON runs BEGIN SELECT RAISE(ABORT, 'runs is append-only: amend the record instead'); END;
CREATE TRIGGER keep_adjustments_update BEFORE UPDATE ON adjustments BEGIN SELECT RAISE(ABORT, 'adjustments is append-only: amend the record instead'); END;
CREATE TRIGGER keep_adjustments_delete BEFORE DELETE ON adjustments BEGIN SELECT RAISE(ABORT, 'adjustments is append-only: amend the record instead'); END;
CREATE TRIGGER keep_calibrations_update BEFORE UPDATE ON calibrations BEGIN SELECT RAISE(ABORT, 'calibrations is append-only: amend the record instead'); END;
CREATE TRIGGER keep_calibrations_delete BEFORE DELETE ON calibrations BEGIN SELECT RAISE(ABORT, 'calibrations is append-only: amend the record instead'); END;
CREATE TRIGGER keep_components_update BEFORE UPDATE ON components BEGIN SELECT RAISE(ABORT, 'components is append-only: amend the record instead'); END;
CREATE TRIGGER keep_components_delete BEFORE DELETE ON components BEGIN SELECT RAISE(ABORT, 'components is append-only: amend the record instead'); END;
CREATE TRIGGER keep_equipment_descriptions_update BEFORE UPDATE ON equipment_descriptions BEGIN SELECT RAISE(ABORT, 'equipment_descriptions is append-only: amend the record instead'); END;
CREATE TRIGGER keep_equipment_descriptions_delete BEFORE DELETE ON equipment_descriptions BEGIN SELECT RAISE(ABORT, 'equipment_descriptions is append-only: amend the record instead'); END;
CREATE TRIGGER keep_reports_update BEFORE UPDATE ON reports BEGIN SELECT RAISE(ABORT, 'reports is append-only: amend the record instead'); END;
CREATE TRIGGER keep_reports_delete BEFORE DELETE ON reports BEGIN SELECT RAISE(ABORT, 'reports is append-only: amend the record instead'); END;
CREATE TRIGGER keep_run_ends_update BEFORE UPDATE ON run_ends BEGIN SELECT RAISE(ABORT, 'run_ends is append-only: amend the record instead'); END;
CREATE TRIGGER keep_run_ends_delete BEFORE DELETE ON run_ends BEGIN SELECT RAISE(ABORT, 'run_ends is append-only: amend the record instead'); END;
CREATE TRIGGER keep_zeroings_update BEFORE UPDATE ON zeroings BEGIN SELECT RAISE(ABORT, 'zeroings is append-only: amend the record instead'); END;
CREATE TRIGGER keep_zeroings_delete BEFORE DELETE ON zeroings BEGIN SELECT RAISE(ABORT, 'zeroings is append-only: amend the record instead'); END;
CREATE TRIGGER keep_certificates_update BEFORE UPDATE ON certificates BEGIN SELECT RAISE(ABORT, 'certificates is append-only: amend the record instead'); END;
CREATE TRIGGER keep_certificates_delete BEFORE DELETE ON certificates BEGIN SELECT RAISE(ABORT, 'certificates is append-only: amend the record instead'); END;
CREATE TRIGGER keep_models_update BEFORE UPDATE ON models BEGIN SELECT RAISE(ABORT, 'models is append-only: amend the record instead'); END;
CREATE TRIGGER keep_models_delete BEFORE DELETE ON models BEGIN SELECT RAISE(ABORT, 'models is append-only: amend the record instead'); END;
CREATE TRIGGER keep_activations_update BEFORE UPDATE ON activations BEGIN SELECT RAISE(ABORT, 'activations is append-only: amend the record instead'); END;
CREATE TRIGGER keep_activations_delete BEFORE DELETE ON activations BEGIN SELECT RAISE(ABORT, 'activations is append-only: amend the record instead'); END;
CREATE TRIGGER keep_checks_update BEFORE UPDATE ON checks BEGIN SELECT RAISE(ABORT, 'checks is append-only: amend the record instead'); END;
CREATE TRIGGER keep_checks_delete BEFORE DELETE ON checks BEGIN SELECT RAISE(ABORT, 'checks is append-only: amend the record instead'); END;
CREATE TRIGGER keep_verifications_update BEFORE UPDATE ON verifications BEGIN SELECT RAISE(ABORT, 'verifications is append-only: amend the record instead'); END;
CREATE TRIGGER keep_verifications_delete BEFORE DELETE ON verifications BEGIN SELECT RAISE(ABORT, 'verifications is append-only: amend the record instead'); END;
COMMIT;
